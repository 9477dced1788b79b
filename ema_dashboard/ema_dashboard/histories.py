"""The histories of all units that are shown, and the monitors that are asked for them."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

from rclpy.client import Client
from rclpy.node import Node

from ema_dashboard.unit_history import MOST_TESTS, ActuatorHistory
from ema_interfaces.msg import ActuatorDescription, FaultEstimate, Health, UnitHistory
from ema_interfaces.srv import GetHistory

_PATIENCE_S: Final = 5.0
_SERVICE_TYPE: Final = "ema_interfaces/srv/GetHistory"


@dataclass
class _Shown:
    """A unit that is shown, and whether its monitor has to be asked."""

    history: ActuatorHistory
    is_wanted: bool = True
    asked_s: float = -_PATIENCE_S


class Histories:
    """Histories of the units of one namespace.

    That of a unit is asked of the monitors when the unit is first seen, and again when a monitor
    has come or begun anew or the unit was replaced; then it is offered to all clients as a whole.
    In between it is carried on with what is published.

    Parameters
    ----------
    node
        Whose clients call the services of the monitors.
    namespace
        Where monitors are looked for.
    offer
        Called with actuator id and history when a client that comes should get it; the last
        argument says whether those present should get it as well.
    """

    def __init__(
        self, node: Node, namespace: str, offer: Callable[[str, ActuatorHistory, bool], None]
    ) -> None:
        self._node = node
        self._prefix = namespace.rstrip("/") + "/"
        self._offer = offer
        self._monitors: dict[str, Client] = {}
        self._ready: set[str] = set()
        self._shown: dict[str, _Shown] = {}

    def note_description(self, message: ActuatorDescription) -> None:
        """Take what is known of an actuator."""
        self._unit(message.actuator_id, message.serial_number)

    def note_estimate(self, message: FaultEstimate) -> None:
        """Take an estimate."""
        shown = self._unit(message.actuator_id, message.serial_number)
        if shown.history.note_estimate(message):
            shown.is_wanted = True
        self._offer(message.actuator_id, shown.history, False)

    def note_health(self, message: Health) -> None:
        """Take the health after an estimate."""
        shown = self._unit(message.actuator_id, message.serial_number)
        shown.history.note_health(message)
        self._offer(message.actuator_id, shown.history, False)

    def rewind(self, time_ns: int) -> None:
        """Forget what is later than a time to which the graph has jumped back [ns]."""
        for actuator_id, shown in self._shown.items():
            shown.history.rewind(time_ns)
            self._offer(actuator_id, shown.history, True)

    def update(self) -> None:
        """Look for monitors and ask them; to be called regularly."""
        self._find_monitors()
        ready = {name for name, client in self._monitors.items() if client.service_is_ready()}
        has_come, self._ready = bool(ready - self._ready), ready
        now_s = time.monotonic()
        for actuator_id, shown in self._shown.items():
            shown.is_wanted |= has_come
            if shown.is_wanted and ready and now_s - shown.asked_s >= _PATIENCE_S:
                shown.asked_s = now_s
                self._ask(actuator_id, shown, [self._monitors[name] for name in sorted(ready)])

    def close(self) -> None:
        """Ask no more."""
        for client in self._monitors.values():
            self._node.destroy_client(client)
        self._monitors.clear()
        self._shown.clear()

    def _unit(self, actuator_id: str, serial_number: str) -> _Shown:
        shown = self._shown.get(actuator_id)
        if shown is None or shown.history.serial_number != serial_number:
            shown = self._shown[actuator_id] = _Shown(ActuatorHistory(actuator_id, serial_number))
            self._offer(actuator_id, shown.history, False)
        return shown

    def _find_monitors(self) -> None:
        for name, types in self._node.get_service_names_and_types():
            if (
                _SERVICE_TYPE in types
                and name.startswith(self._prefix)
                and name not in self._monitors
            ):
                self._monitors[name] = self._node.create_client(GetHistory, name)

    def _ask(self, actuator_id: str, shown: _Shown, monitors: Iterable[Client]) -> None:
        request = GetHistory.Request(actuator_id=actuator_id, most=MOST_TESTS)
        for client in monitors:
            client.call_async(request).add_done_callback(
                lambda future: self._take(actuator_id, shown, future)
            )

    def _take(self, actuator_id: str, shown: _Shown, future: Any) -> None:
        """Take the answer of a monitor; one that does not know the unit has none."""
        response: Any = future.result()
        shown.is_wanted = False
        if response is None or not response.success or self._shown.get(actuator_id) is not shown:
            return
        history: UnitHistory = response.history
        if history.serial_number == shown.history.serial_number:
            shown.history.set_base(history)
            self._offer(actuator_id, shown.history, True)
