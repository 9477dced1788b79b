# SPDX-License-Identifier: Apache-2.0
"""Status of the monitored actuators, and expiry of their levels."""

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
from ema_monitor.prognosis.events import UnitEvent
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.reason_texts import text_of
from ema_monitor.reasons import MonitorInactive
from ema_monitor.windows.finder import WindowFinder
from ema_ros.node_parameters import LiveSettings
from ema_ros.status import STALE, Task

NOT_ACTIVE: Final = text_of(MonitorInactive())
_MOST_NAMED: Final = 10


class Actuators(dict[str, ActuatorStatus]):
    """Status by actuator name: listed actuators first, then in order of their first message.

    Parameters
    ----------
    outputs
        Publishers of each actuator's topics.
    namespace
        Namespace of the telemetry.
    read_clock
        Returns the time and the backward clock step since the previous call [ns].
    operation
        Limits and timeouts.
    why_not
        Returns why an actuator is not monitored; empty if it may be monitored.
    rewind
        Discards tests later than a time [ns] to which simulated time has stepped back.
    mark_clock_step
        Marks all tests so far as measured before a step of the clock.
    log
        Log of the node.

    Attributes
    ----------
    lock
        Held while actuators change and while health is published, so that outdated health is never
        published after newer health. It is acquired after the lock of the histories, never before.
    is_active
        Whether the monitor is active; an inactive monitor publishes no level.
    """

    def __init__(
        self,
        outputs: Outputs,
        namespace: str,
        read_clock: Callable[[], tuple[Moment, int]],
        operation: LiveSettings[Operation],
        why_not: Callable[[str], str],
        rewind: Callable[[int], None],
        mark_clock_step: Callable[[], None],
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
        self._mark_clock_step = mark_clock_step
        self._log = log

    def follow(self, actuator_id: str, finder: WindowFinder, stream: Stream) -> ActuatorStatus:
        """Start publishing the status of an actuator. Return the status."""
        self._outputs.add(actuator_id)
        publish, now = self._outputs.publish_health, self.now()
        status = self[actuator_id] = ActuatorStatus(
            actuator_id, finder, publish, now.steady_ns, stream, self._namespace
        )
        return status

    def forget(self, actuator_id: str) -> None:
        """Withdraw the level of an actuator, and stop publishing its status."""
        self.pop(actuator_id).health.withdraw("the actuator is forgotten")
        self._outputs.remove(actuator_id)

    def clear(self) -> None:
        """Stop publishing the status of all actuators."""
        super().clear()
        self._outputs.clear()

    def now(self) -> Moment:
        """Return the current time. If the clock has stepped back, withdraw all levels."""
        with self.lock:
            now, back_ns = self._read_clock()
            if back_ns:
                self._step_back(now, back_ns * 1e-9)
            return now

    def _step_back(self, now: Moment, back_s: float) -> None:
        """Withdraw the levels of all actuators after a backward step of the clock.

        In simulated time, later tests are discarded. Otherwise all tests are marked as measured
        before the step.
        """
        reason = f"the clock went back by {back_s:.0f} s: the next test gives the level"
        self._log.warning(reason)
        for status in self.values():
            status.health.end_claim(reason)
        if now.is_real:
            self._mark_clock_step()
        else:
            self._rewind(now.clock_ns)

    def find(self, actuator_id: str) -> tuple[ActuatorStatus, ActuatorDescription]:
        """Return the status and description of an actuator; "" selects the only actuator.

        Raises
        ------
        ValueError
            If the actuator is not monitored or not described, or if "" is ambiguous.
        """
        with self.lock:
            if not actuator_id and len(self) != 1:
                raise ValueError(
                    f"actuator_id is empty: expected a monitored actuator: {self._listing()}"
                )
            status = self.get(actuator_id or next(iter(self)))
        if status is None:
            raise ValueError(self.not_monitored(actuator_id))
        if status.description is None:
            raise ValueError(f"actuator {status.actuator_id!r} has not been described")
        return status, status.description

    def not_monitored(self, actuator_id: str) -> str:
        """Return an error message for an actuator that is not monitored, with the reason."""
        reason = self._why_not(actuator_id) or f"monitored: {self._listing()}"
        return f"actuator_id = {actuator_id!r} is not monitored; {reason}"

    def _listing(self) -> str:
        names = list(self)
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        return (", ".join(names[:_MOST_NAMED]) or "none") + more

    def claimed(self, status: ActuatorStatus, outlook: Outlook) -> Outlook:
        """Return an outlook with the validity period that the actuator's tests require."""
        good_for_s = status.good_for_s(self._operation.value)
        return replace(outlook, claim=outlook.claim._replace(good_for_s=good_for_s))

    def worth(self, description: ActuatorDescription, outlook: Outlook) -> Outlook:
        """Return the current outlook of a mounted unit; STALE if its level has expired."""
        with self.lock:
            status, now = self[description.actuator_id], self.now()
            return status.health.worth(self.claimed(status, outlook), now)

    def add_defect(self, actuator_id: str, reason: str) -> None:
        """Record and report a defect of an actuator."""
        with self.lock:
            status = self.get(actuator_id)
            is_first = status is not None and status.add_defect(reason)
        self._log.warn(actuator_id, reason, is_first=is_first)

    def add_events(self, actuator_id: str, events: tuple[UnitEvent, ...]) -> None:
        """Publish the unchanged health of an actuator again, with new events."""
        with self.lock:
            status = self.get(actuator_id)
            if status is not None and self.is_active:
                status.health.add_events(events)

    def show_learning(
        self, description: ActuatorDescription, text: str, *, is_learning: bool = True
    ) -> None:
        """Withdraw the level of a unit and show why it has none; an empty text changes nothing.

        Parameters
        ----------
        description
            The unit.
        text
            Why there is no level.
        is_learning
            Whether the unit is learning.
        """
        with self.lock:
            status = self.get(description.actuator_id)
            if status is None or not text:
                return
            status.learning = text if is_learning else ""
            if self.is_active and status.health.end_claim(text) is None:
                status.health.withdraw(text)

    def expire(self) -> list[HealthMessage]:
        """Publish health that has just become stale. Return the messages."""
        with self.lock:
            now, operation = self.now(), self._operation.value
            published = [
                status.expire(status.good_for_s(operation), now) for status in self.values()
            ]
        return [health for health in published if health is not None]

    def withdraw(self) -> None:
        """Publish unknown health for all actuators because the monitor is inactive."""
        with self.lock:
            for status in self.values():
                status.health.withdraw(NOT_ACTIVE)

    def receives_telemetry(self) -> bool:
        """Return whether any actuator sends telemetry."""
        with self.lock:
            return any(status.finder.blocks and not status.is_silent for status in self.values())

    def telemetry(self, dropped: dict[str, int]) -> list[TelemetryStatus]:
        """Return the message counts of each actuator; ``dropped`` counts its dropped windows."""
        with self.lock:
            return [telemetry_status(status, dropped.get(name, 0)) for name, status in self.items()]

    def tasks(self, actuator_id: str, waiting: int, dropped: dict[str, int]) -> list[Task]:
        """Return the status of an actuator, or of all actuators for an empty name.

        ``waiting`` is the number of queued windows of all actuators, and ``dropped`` the number of
        dropped windows by actuator.
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
            replace(task, level=STALE, message=f"{NOT_ACTIVE}, before: {task.message}")
            for task in tasks
        ]
