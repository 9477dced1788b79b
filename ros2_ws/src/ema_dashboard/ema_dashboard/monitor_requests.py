# SPDX-License-Identifier: Apache-2.0
"""Requests of clients to monitors: notes on events, and changes of baselines."""

from typing import Any, Final

from builtin_interfaces.msg import Time
from rclpy.client import Client
from rclpy.node import Node

from ema_core.wording import one_line
from ema_dashboard.hub import Hub
from ema_dashboard.service_call import call
from ema_interfaces.srv import ChangeBaseline, NoteEvent

_MOST_TEXT: Final = 1000
_SERVICES: Final = (NoteEvent, ChangeBaseline)
_CHANGES: Final = {
    "accept": ChangeBaseline.Request.ACCEPT,
    "extend": ChangeBaseline.Request.EXTEND,
    "reset": ChangeBaseline.Request.RESET,
}


class MonitorRequests:
    """Sends requests of clients to the monitors of one namespace.

    Parameters
    ----------
    node
        Node for the service clients.
    namespace
        Namespace of the monitors.
    hub
        Hub whose event loop sends the requests.
    """

    def __init__(self, node: Node, namespace: str, hub: Hub) -> None:
        self._node = node
        self._prefix = namespace.rstrip("/") + "/"
        self._hub = hub
        self._clients: dict[str, tuple[type, Client]] = {}

    def update(self) -> None:
        """Discover the services of monitors. Call periodically."""
        for name, types in self._node.get_service_names_and_types():
            if name in self._clients or not name.startswith(self._prefix):
                continue
            for service in _SERVICES:
                if f"ema_interfaces/srv/{service.__name__}" in types:
                    client = self._node.create_client(service, name)
                    self._clients[name] = service.Request, client

    async def send(self, request: Any) -> None:
        """Send a request to the monitors, one after the other, until one accepts it.

        Raises
        ------
        ValueError
            If no monitor is running, or every monitor refuses the request; with the reasons.
        """
        reasons = []
        for name, (request_class, client) in tuple(self._clients.items()):
            if isinstance(request, request_class):
                try:
                    return await call(self._hub, client, name, request)
                except ValueError as error:
                    reasons.append(str(error))
        raise ValueError("; ".join(reasons) or "no monitor is running")


def read_note(content: Any) -> tuple[str, NoteEvent.Request]:
    """Parse a client's note in JSON. Return namespace and request; ValueError if invalid."""
    match content:
        case {
            "namespace": str(namespace),
            "actuator_id": str(actuator_id),
            "sec": int(sec),
            "nanosec": int(nanosec),
            "person": str(person),
            "text": str(text),
        } if 0 <= sec < 2**31 and 0 <= nanosec < 2**31:
            return namespace, NoteEvent.Request(
                actuator_id=one_line("actuator_id", actuator_id, _MOST_TEXT),
                stamp=Time(sec=int(sec), nanosec=int(nanosec)),
                person=one_line("person", person, _MOST_TEXT),
                text=one_line("text", text, _MOST_TEXT),
            )
    raise ValueError("expected namespace, actuator_id, sec, nanosec, person and text as JSON")


def read_baseline_change(content: Any) -> tuple[str, ChangeBaseline.Request]:
    """Parse a client's request in JSON to change a baseline. Return namespace and request.

    Raises
    ------
    ValueError
        If the content is invalid.
    """
    match content:
        case {
            "namespace": str(namespace),
            "actuator_id": str(actuator_id),
            "change": str(change),
            "person": str(person),
            "note": str(note),
            "force": bool(force),
        } if change in _CHANGES:
            return namespace, ChangeBaseline.Request(
                actuator_id=one_line("actuator_id", actuator_id, _MOST_TEXT),
                change=_CHANGES[change],
                person=one_line("person", person, _MOST_TEXT),
                note=one_line("note", note, _MOST_TEXT) if note.strip() else "",
                force=force,
            )
    raise ValueError(
        "expected namespace, actuator_id, change (accept, extend or reset), person, note and force "
        "as JSON"
    )
