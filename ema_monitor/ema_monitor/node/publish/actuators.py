"""The actuators that a monitor follows, as they are reported, and the time of their claims."""

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import Health as HealthMessage
from ema_interfaces.msg import TelemetryStatus
from ema_monitor.node.moment import Moment
from ema_monitor.node.publish.actuator_status import ActuatorStatus
from ema_monitor.node.publish.log import Log
from ema_monitor.node.publish.outputs import Outputs
from ema_monitor.node.publish.shown_health import Stream
from ema_monitor.node.publish.unit_status import telemetry_status, unit_tasks
from ema_monitor.node.settings import Operation
from ema_monitor.prognosis.history_entry import UnitEvent
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.windows.finder import WindowFinder
from ema_ros.node_parameters import LiveSettings
from ema_ros.status import STALE, Task

NOT_ACTIVE: Final = "the monitor is not active"
_MOST_NAMED: Final = 10


class Actuators(dict[str, ActuatorStatus]):
    """Actuators by name: those that are listed, then in the order of their first message.

    Parameters
    ----------
    outputs
        Topics of each actuator.
    namespace
        Namespace of the telemetry.
    read_clock
        Returns the time, and by how much the clock has stepped back since the last call [ns].
    why_not
        Returns why an actuator is not to be followed by this monitor; empty when it is.
    rewind
        Forgets tests later than a time to which simulated time has gone back [ns].

    Attributes
    ----------
    lock
        Held while actuators are changed, and while health is published: nothing older may follow
        the health after a test.
    is_active
        Whether the monitor is active: otherwise no level is published.
    """

    def __init__(
        self,
        outputs: Outputs,
        namespace: str,
        read_clock: Callable[[], tuple[Moment, int]],
        operation: LiveSettings[Operation],
        why_not: Callable[[str], str],
        rewind: Callable[[int], None],
        log: Log,
    ) -> None:
        super().__init__()
        self.lock = threading.RLock()
        self.is_active = False
        self._outputs = outputs
        self._namespace = namespace
        self._read_clock = read_clock
        self._operation = operation
        self._why_not = why_not
        self._rewind = rewind
        self._log = log

    def follow(self, actuator_id: str, finder: WindowFinder, stream: Stream) -> ActuatorStatus:
        """Return the status of an actuator, which is published from now on."""
        self._outputs.add(actuator_id)
        publish, now = self._outputs.publish_health, self.now()
        status = self[actuator_id] = ActuatorStatus(
            actuator_id, finder, publish, now.steady_ns, stream, self._namespace
        )
        return status

    def forget(self, actuator_id: str) -> None:
        """Publish nothing of an actuator any more."""
        del self[actuator_id]
        self._outputs.remove(actuator_id)

    def clear(self) -> None:
        """Publish nothing of any actuator any more."""
        super().clear()
        self._outputs.clear()

    def now(self) -> Moment:
        """Return the time; where the clock has stepped back, no level of before is known."""
        with self.lock:
            now, back_ns = self._read_clock()
            if back_ns:
                self._step_back(now, back_ns * 1e-9)
            return now

    def _step_back(self, now: Moment, back_s: float) -> None:
        """End the claims of all actuators; forget what is later in simulated time."""
        reason = f"the clock went back by {back_s:.0f} s: the next test gives the level"
        self._log.warning(reason)
        for status in self.values():
            status.health.end_claim(reason)
        if not now.is_real:
            self._rewind(now.clock_ns)

    def find(self, actuator_id: str) -> tuple[ActuatorStatus, ActuatorDescription]:
        """Return an actuator that is described, and its description; the only one for "".

        One that is not known or not described, or a choice, is a ValueError.
        """
        with self.lock:
            if not actuator_id and len(self) != 1:
                raise ValueError(
                    f"actuator_id is empty: expected one of those monitored: {self._in_words()}"
                )
            status = self.get(actuator_id or next(iter(self)))
        if status is None:
            raise ValueError(self.not_monitored(actuator_id))
        if status.description is None:
            raise ValueError(f"actuator {status.actuator_id!r} has not been described")
        return status, status.description

    def not_monitored(self, actuator_id: str) -> str:
        """Return that an actuator is not monitored, why not, or which ones are."""
        reason = self._why_not(actuator_id) or f"monitored: {self._in_words()}"
        return f"actuator_id = {actuator_id!r} is not monitored; {reason}"

    def _in_words(self) -> str:
        names = list(self)
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        return (", ".join(names[:_MOST_NAMED]) or "none") + more

    def claimed(self, status: ActuatorStatus, outlook: Outlook) -> Outlook:
        """Return an outlook that holds as long as the tests of an actuator require."""
        good_for_s = status.good_for_s(self._operation.value)
        return replace(outlook, claim=outlook.claim._replace(good_for_s=good_for_s))

    def worth(self, description: ActuatorDescription, outlook: Outlook) -> Outlook:
        """Return what an outlook of a unit that is mounted is worth at this time."""
        with self.lock:
            status, now = self[description.actuator_id], self.now()
            return status.health.worth(self.claimed(status, outlook), now)

    def add_defect(self, actuator_id: str, reason: str) -> None:
        """Record and report a defect of an actuator."""
        with self.lock:
            status = self.get(actuator_id)
            is_first = status is not None and status.add_defect(reason)
        self._log.warn(actuator_id, reason, is_first=is_first)

    def tell(self, actuator_id: str, events: tuple[UnitEvent, ...]) -> None:
        """Publish the health of an actuator as it is, with events."""
        with self.lock:
            status = self.get(actuator_id)
            if status is not None and self.is_active:
                status.health.tell(events)

    def expire(self) -> list[HealthMessage]:
        """Publish levels that have just become stale, and return them."""
        with self.lock:
            now, operation = self.now(), self._operation.value
            published = [
                status.expire(status.good_for_s(operation), now) for status in self.values()
            ]
        return [health for health in published if health is not None]

    def withdraw(self) -> None:
        """Publish that no health is known any more, as the monitor is not active."""
        with self.lock:
            for status in self.values():
                status.health.withdraw(NOT_ACTIVE)

    def is_any_heard(self) -> bool:
        """Return whether telemetry of any actuator is received."""
        with self.lock:
            return any(one.finder.blocks and not one.is_silent for one in self.values())

    def telemetry(self, dropped: dict[str, int]) -> list[TelemetryStatus]:
        """Return what is counted of each actuator, with the number of windows dropped."""
        with self.lock:
            return [telemetry_status(one, dropped.get(name, 0)) for name, one in self.items()]

    def tasks(self, actuator_id: str, waiting: int, dropped: dict[str, int]) -> list[Task]:
        """Return the status of one actuator, of each one when the name is empty.

        ``waiting`` windows of all actuators wait, and so many of each were dropped.
        """
        with self.lock:
            tasks = [
                task
                for name, status in self.items()
                if actuator_id in ("", name)
                for task in unit_tasks(status, waiting, dropped.get(name, 0))
            ]
        if self.is_active:
            return tasks
        return [
            replace(one, level=STALE, message=f"{NOT_ACTIVE}, before: {one.message}")
            for one in tasks
        ]
