"""The histories of all units that are shown, and the monitors that are asked for them."""

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from builtin_interfaces.msg import Time
from rclpy.client import Client
from rclpy.node import Node

from ema_dashboard.unit_history import MOST_TESTS, ActuatorHistory
from ema_interfaces.msg import (
    ActuatorDescription,
    FaultEstimate,
    Health,
    UnitEvent,
    UnitHistory,
)
from ema_interfaces.srv import GetHistory

_PATIENCE_S: Final = 5.0
_SERVICE_TYPE: Final = "ema_interfaces/srv/GetHistory"


@dataclass
class _Shown:
    """A unit that is shown, and whether its monitor has to be asked."""

    history: ActuatorHistory
    is_wanted: bool = True
    answered: set[str] = field(default_factory=set)  # services that have, since it is wanted
    asked_s: dict[str, float] = field(default_factory=dict)  # by service
    wants: int = 0  # how often it was wanted again

    def want(self) -> None:
        self.wants += 1
        self.is_wanted = True
        self.answered.clear()


class Histories:
    """Histories of the units of one namespace.

    That of a unit is asked of the monitors when the unit is first seen, and again when a monitor
    has come or begun anew or the unit was replaced; then it is offered to all clients as a whole.
    In between it is carried on with what is published. A monitor has one question at a time to
    answer; one that it leaves open is asked again later, those of other units first.

    Parameters
    ----------
    node
        Whose clients call the services of the monitors.
    namespace
        Where monitors are looked for.
    offer
        Called with actuator id and history when a client that comes should get it; the last
        argument says whether those present should get it as well.
    add
        Called with what those present should add to a history that they have.
    """

    def __init__(
        self,
        node: Node,
        namespace: str,
        offer: Callable[[str, ActuatorHistory, bool], None],
        add: Callable[[UnitHistory], None],
    ) -> None:
        self._node = node
        self._prefix = namespace.rstrip("/") + "/"
        self._offer = offer
        self._add = add
        self._monitors: dict[str, Client] = {}
        self._ready: set[str] = set()
        self._shown: dict[str, _Shown] = {}
        self._lost: dict[str, int] = {}  # samples, by actuator
        # Futures and times of the open questions, by service; answers come in any thread.
        self._open: dict[str, tuple[Any, float]] = {}
        self._lock = threading.RLock()

    def note_description(self, message: ActuatorDescription) -> None:
        """Take what is known of an actuator."""
        self._unit(message.actuator_id, message.serial_number)

    def note_estimate(self, message: FaultEstimate) -> None:
        """Take an estimate."""
        shown = self._unit(message.actuator_id, message.serial_number)
        began_anew, events = shown.history.note_estimate(message)
        if began_anew:
            shown.want()
        self._offer(message.actuator_id, shown.history, False)
        self._tell(shown.history, events)

    def note_health(self, message: Health) -> None:
        """Take the health after an estimate."""
        shown = self._unit(message.actuator_id, message.serial_number)
        shown.history.note_health(message)
        self._offer(message.actuator_id, shown.history, False)

    def note_lost_samples(self, actuator_id: str, stamp: Time, samples: int) -> None:
        """Take the number of samples of an actuator that are missing since its monitor started."""
        before = self._lost.get(actuator_id)
        self._lost[actuator_id] = samples
        shown = self._shown.get(actuator_id)
        # When the first ones were lost is not known.
        if before is not None and samples > before and shown is not None:
            events = shown.history.note_gap(stamp, samples - before)
            self._offer(actuator_id, shown.history, False)
            self._tell(shown.history, events)

    def rewind(self, time_ns: int) -> None:
        """Forget what is later than a time to which the graph has jumped back [ns]."""
        for actuator_id, shown in self._shown.items():
            shown.history.rewind(time_ns)
            self._offer(actuator_id, shown.history, True)

    def update(self) -> None:
        """Look for monitors and ask them; to be called regularly."""
        self._find_monitors()
        ready = {name for name, client in self._monitors.items() if client.service_is_ready()}
        if ready - self._ready:
            for shown in list(self._shown.values()):
                shown.want()
        self._ready = ready
        for name in sorted(self._monitors):
            self._give_up(name)
            if name in ready:
                self._ask_next(name)

    def close(self) -> None:
        """Ask no more."""
        with self._lock:
            for client in self._monitors.values():
                self._node.destroy_client(client)
            self._monitors.clear()
            self._open.clear()
        self._shown.clear()

    def _unit(self, actuator_id: str, serial_number: str) -> _Shown:
        shown = self._shown.get(actuator_id)
        if shown is None or shown.history.serial_number != serial_number:
            shown = self._shown[actuator_id] = _Shown(ActuatorHistory(actuator_id, serial_number))
            self._offer(actuator_id, shown.history, False)
        return shown

    def _tell(self, history: ActuatorHistory, events: list[UnitEvent]) -> None:
        if events:
            self._add(history.addition(events))

    def _find_monitors(self) -> None:
        for name, types in self._node.get_service_names_and_types():
            if (
                _SERVICE_TYPE in types
                and name.startswith(self._prefix)
                and name not in self._monitors
            ):
                self._monitors[name] = self._node.create_client(GetHistory, name)

    def _give_up(self, name: str) -> None:
        """Wait no more for an answer that is overdue or whose service has gone."""
        with self._lock:
            future, asked_s = self._open.get(name, (None, 0.0))
            overdue = time.monotonic() - asked_s >= _PATIENCE_S
            if future is not None and (overdue or name not in self._ready):
                self._monitors[name].remove_pending_request(future)
                del self._open[name]

    def _ask_next(self, name: str) -> None:
        """Ask a monitor for the unit of which it was not asked for longest, if none is open."""
        with self._lock:
            now_s = time.monotonic()
            due = {
                actuator_id: shown
                for actuator_id, shown in list(self._shown.items())
                if shown.is_wanted
                and name not in shown.answered
                and now_s - shown.asked_s.get(name, -math.inf) >= _PATIENCE_S
            }
            if not due or name in self._open or name not in self._monitors:
                return
            actuator_id = min(due, key=lambda item: due[item].asked_s.get(name, -math.inf))
            shown = due[actuator_id]
            shown.asked_s[name] = now_s
            request = GetHistory.Request(actuator_id=actuator_id, most=MOST_TESTS)
            future = self._monitors[name].call_async(request)
            self._open[name] = future, now_s
            wants = shown.wants
        future.add_done_callback(lambda done: self._take(name, actuator_id, shown, wants, done))

    def _take(self, name: str, actuator_id: str, shown: _Shown, wants: int, future: Any) -> None:
        """Take the answer of a monitor; one that does not know the unit has none.

        One to a question from before the history was wanted again says how it was then.
        """
        with self._lock:
            if self._open.get(name, (None,))[0] is future:
                del self._open[name]
        response: Any = future.result()
        history: UnitHistory | None = response.history if response and response.success else None
        is_meant = history is not None and history.serial_number == shown.history.serial_number
        if wants == shown.wants:
            shown.answered.add(name)
            if is_meant or shown.answered >= self._ready:
                shown.is_wanted = False
        if history is not None and is_meant and self._shown.get(actuator_id) is shown:
            shown.history.set_base(history)
            self._offer(actuator_id, shown.history, True)
        self._ask_next(name)
