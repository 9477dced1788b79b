"""The actuators that a monitor follows, and what it receives of them."""

import threading
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ema_core.description import ActuatorDescription, UnitKey, check_name
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.intake import MOST_MEASUREMENTS, Intake, Use
from ema_monitor.model.measurements import MeasurementLog
from ema_monitor.node.actuator import Actuator
from ema_monitor.node.admission import Admission
from ema_monitor.node.messages import estimate_to_message
from ema_monitor.node.receiver_clock import Moment, ReceiverClock
from ema_monitor.prognosis.duty.damage import NOTHING_FLOWN
from ema_monitor.prognosis.history_entry import Count, UnitEvent
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.service import CountLog
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Defect, Refusal, TriggerSettings
from ema_monitor.windows.window import Window
from ema_ros.messages import description_from_message, measured_from_message, telemetry_from_message
from ema_ros.stamps import stamp_from_message

if TYPE_CHECKING:
    from ema_monitor.node.monitor_node import MonitorNode

_CLOCK_FILE: Final = "clock.json"
_MOST_NAMED: Final = 10
_MOST_DESCRIBED: Final = 1000


class Actuators(dict[str, Actuator]):
    """Actuators by name: those that are listed, then in the order of their first message.

    What is received may be impossible: then it is reported as a defect of its actuator, or of
    nobody.

    Attributes
    ----------
    lock
        Held while units are changed, and while health is published: nothing older may follow the
        health after a test.
    """

    def __init__(self, node: "MonitorNode", admission: Admission, trigger: TriggerSettings) -> None:
        super().__init__()
        self.lock = threading.RLock()
        self.admission = admission
        self._node = node
        self._trigger = trigger
        self._measurements = MeasurementLog(MOST_MEASUREMENTS)
        self._counts = CountLog()
        # Latched topics describe an actuator once: it is kept for its return.
        self._described: dict[str, ActuatorDescription] = {}
        self._clock = ReceiverClock(self.now_ns)

    def begin(self, folder: Path | None) -> None:
        """Read the clock of the node from now on, and keep its steps in a folder, if any."""
        is_simulated = bool(self._node.get_parameter("use_sim_time").value)
        kept = folder / _CLOCK_FILE if folder else None
        self._clock = ReceiverClock(self.now_ns, is_simulated=is_simulated, kept=kept)

    def clear(self) -> None:
        """Remove all, and forget what was received."""
        super().clear()
        self.admission.clear()
        self._described.clear()
        self._measurements.clear()
        self._counts = CountLog()

    def now_ns(self) -> int:
        """Return the time of the node's clock [ns]."""
        return self._node.get_clock().now().nanoseconds

    def now(self) -> Moment:
        """Return the time; where the clock has stepped back, no level of before is known."""
        with self.lock:
            now, back_ns = self._clock.read()
            if back_ns:
                self._step_back(now, back_ns * 1e-9)
            return now

    def _step_back(self, now: Moment, back_s: float) -> None:
        """End the claims of all actuators; forget what is later in simulated time."""
        reason = f"the clock went back by {back_s:.0f} s: the next test gives the level"
        self._node.get_logger().warning(reason)
        for unit in self.values():
            unit.end_claim(reason)
        if self._clock.is_simulated:
            self._node.prognosis.rewind(now.clock_ns)

    def expect_listed(self) -> None:
        """Add the actuators that are listed, so that one that says nothing is seen."""
        self.admission.check()
        for actuator_id in self.admission.listed:
            self.get_or_add(actuator_id)

    def forget(self, actuator_id: str) -> None:
        """Follow an actuator no more, whose name is as it was received; what is on disk stays.

        One that is not known is a ValueError.
        """
        node = self._node
        with self.lock:
            unit = self.get(actuator_id)
            if unit is None:
                raise ValueError(self._not_monitored(actuator_id))
            unit.intake.finish()
            if unit.description is not None:
                self._remember(unit.description)
            del self[actuator_id]
            self._measurements.forget(actuator_id)
            node.remove_publishers(actuator_id)
        node.worker.queue.forget(actuator_id)
        node.prognosis.forget(actuator_id)
        node.report()

    def check(self) -> None:
        """Publish levels that have just become stale, and end records of silent actuators."""
        node, operation = self._node, self._node.operation.value
        if not node.is_active:
            return
        with self.lock:
            now = self.now()
            published = [
                unit.publish_if_stale(unit.good_for_s(operation), now) for unit in self.values()
            ]
            for unit in self.values():
                # The position does not show that the telemetry has ended.
                if unit.is_silent and unit.finder.finds_records:
                    self._handle(unit, unit.intake.finish())
        stale = [health for health in published if health is not None]
        for health in stale:
            node.get_logger().warning(f"{health.actuator_id}: {health.reason}")
        if stale:
            node.report()

    def receive_description(self, message: Any) -> None:
        """Apply ``ema_interfaces/msg/ActuatorDescription``."""
        if not self._takes(message, "description"):
            return
        try:
            self.describe(description_from_message(message))
        except ValueError as error:
            self.add_defect(message.actuator_id, f"the description is impossible: {error}")

    def describe(self, description: ActuatorDescription) -> None:
        """Apply the description of an actuator, if it is followed."""
        with self.lock:
            unit = self.get_or_add(description.actuator_id, description)
            if unit is None:
                return
            before = unit.description
            self._handle(unit, unit.intake.describe(description))
            if before is not None and before.serial_number != description.serial_number:
                unit.reset_health(self.now().steady_ns)
                if unit.exchange(before.serial_number, description.serial_number):
                    self._node.warn(unit.actuator_id, unit.alternation, is_first=True)
        if before != description:
            self._prepare(description)

    def _prepare(self, description: ActuatorDescription) -> None:
        """Prepare for a unit that has just been described."""
        for remark in description.remarks:
            self._node.get_logger().warning(f"{description.actuator_id}: {remark}")
        self._node.prognosis.describe(description)

    def receive_telemetry(self, message: Any) -> None:
        """Look for windows in ``ema_interfaces/msg/TelemetryBlock``."""
        if not self._takes(message, "telemetry"):
            return
        actuator_id = message.actuator_id
        with self.lock:
            unit = self.get_or_add(actuator_id)
            if unit is None:
                return
            unit.heard_ns, unit.is_silent = self.now().steady_ns, False
            try:
                block = telemetry_from_message(message)
            except ValueError as error:
                stamp_ns = stamp_from_message(message.header.stamp)
                events = unit.intake.reject(stamp_ns, str(error))
            else:
                unit.arrivals.add(block.stamp_ns, block.stamp_at(len(block)), unit.heard_ns)
                events = unit.intake.feed(block)
            if unit.finder.blocks == 1:
                self._node.get_logger().info(f"{actuator_id}: first telemetry")
            self._handle(unit, events)

    def is_live(self, actuator_id: str, end_ns: int) -> bool:
        """Return whether a test that ends at a stamp [ns] was received while it was measured."""
        with self.lock:
            return actuator_id in self and self[actuator_id].arrivals.are_live(end_ns)

    def take_use(self, unit_key: UnitKey, end_ns: int) -> Use:
        """Return the use of a unit up to a test that ends at a stamp [ns]; its duty only once."""
        with self.lock:
            if (unit := self.get(unit_key[0])) is None:
                return Use(self._counts.latest(unit_key, end_ns), NOTHING_FLOWN)
            return unit.intake.take_use(unit_key, end_ns)

    def receive_measured(self, message: Any) -> None:
        """Keep ``ema_interfaces/msg/MeasuredCauses``."""
        if not self._takes(message, "measured causes"):
            return
        actuator_id = message.actuator_id
        try:
            stamp_ns, measured = measured_from_message(message)
            with self.lock:
                self._measurements.add(actuator_id, stamp_ns, measured)
        except ValueError as error:
            # A measurement alone does not make an actuator known.
            self.add_defect(actuator_id, str(error), is_known=actuator_id in self)

    def receive_usage(self, message: Any) -> None:
        """Record counted use from ``ema_interfaces/msg/Usage``."""
        if not self._takes(message, "usage"):
            return
        actuator_id = message.actuator_id
        unit = self.get(actuator_id)
        described = unit.description if unit else None
        # One that its sender did not stamp, or without a clock, was read just now.
        has_clock = self._node.operation.value.has_clock
        stamp_ns = stamp_from_message(message.header.stamp) if has_clock else 0
        try:
            count = Count(stamp_ns or self.now_ns(), message.flight_hours, message.cycles)
            # A count without a serial number is of the unit that is described.
            serial_number = message.serial_number or (described.serial_number if described else "")
            self._counts.add((actuator_id, serial_number), count)
        except ValueError as error:
            # A count alone does not make an actuator known.
            reason = f"usage is impossible: {error}"
            self.add_defect(actuator_id, reason, is_known=unit is not None)

    def _takes(self, message: Any, what: str) -> bool:
        """Return whether a message is of an actuator that is to be followed; note if not."""
        actuator_id = message.actuator_id
        if actuator_id in self:
            return True
        if actuator_id and self.admission.ignores(actuator_id):
            return False
        try:
            check_name("actuator_id", actuator_id)
        except ValueError:
            wrong = "with an impossible" if actuator_id else "without"
            self.add_defect(actuator_id, f"{what} {wrong} actuator_id", is_known=False)
            return False
        return True

    def restart(self, settings: TriggerSettings) -> None:
        """Look for windows with other settings from now on; a window that is open is refused."""
        with self.lock:
            self._trigger = settings
            for unit in self.values():
                events = unit.intake.restart(settings, "the settings of the window changed")
                # Nothing is wrong where no window is cut off.
                self._handle(unit, [event for event in events if isinstance(event, Segment)])

    def finish(self) -> list[Segment]:
        """End the telemetry of all; return the refusals of the windows that are cut off."""
        with self.lock:
            events = [event for unit in self.values() for event in unit.intake.finish()]
        return [_cut_off(event) for event in events if isinstance(event, Segment)]

    def _handle(self, unit: Actuator, events: Iterable[Segment | Defect]) -> None:
        """Queue windows for identification, and report defects."""
        for event in events:
            if isinstance(event, Defect):
                self.add_defect(unit.actuator_id, event.reason)
                continue
            if isinstance(event.window, Window):
                unit.latest = event
            for queue in tuple(unit.awaiting):
                queue.put(event)
            self._node.worker.add(event)

    def add_defect(self, actuator_id: str, reason: str, *, is_known: bool = True) -> None:
        """Record and report a defect, of nobody where no actuator is named or it is not known."""
        with self.lock:
            unit = self.get_or_add(actuator_id) if actuator_id and is_known else None
            if unit is not None:
                is_first = unit.add_defect(reason)
            else:
                is_first = self.admission.note_wrong(actuator_id, reason)
        self._node.warn(actuator_id, reason, is_first=is_first)

    def find(self, actuator_id: str) -> tuple[Actuator, ActuatorDescription]:
        """Return a unit that is described, and its description; the only one for an empty name.

        One that is not known or not described, or a choice, is a ValueError.
        """
        with self.lock:
            if not actuator_id and len(self) != 1:
                raise ValueError(
                    f"actuator_id is empty: expected one of those monitored: {self._in_words()}"
                )
            unit = self.get(actuator_id or next(iter(self)))
        if unit is None:
            raise ValueError(self._not_monitored(actuator_id))
        if unit.description is None:
            raise ValueError(f"actuator {unit.actuator_id!r} has not been described")
        return unit, unit.description

    def publish_estimate(self, found: Diagnosed, window: Window | Refusal | None = None) -> None:
        """Publish an estimate, that of a window where one is given, and what follows from it."""
        node, description, estimate = self._node, found.description, found.estimate
        actuator_id, change = description.actuator_id, ""
        node.estimates.publish(estimate_to_message(estimate, found.number, description))
        self.now()  # a step of the clock comes before the test
        # Without the lock: telemetry must not wait for a prognosis.
        outlook = node.prognosis.record(description, estimate)
        try:
            with self.lock:
                if unit := self.get(actuator_id):
                    outlook = self._claimed(unit, outlook) if outlook else None
                    change = unit.record(found, outlook, self.now())
        except Exception as error:
            # The estimate is published: the window must not be refused in addition.
            reason = node.failed(actuator_id, "publishing health", error)
            self.add_defect(actuator_id, reason)
        self._follow(description, outlook if estimate.valid else None, change)
        if isinstance(window, Window):
            node.follow_ups.follow_estimate(found, window)
        if not estimate.valid:
            reason = f"window {found.number} has no valid estimate: {estimate.reason}"
            node.warn(actuator_id, reason)
        # Of all of many actuators it would take longer than an identification.
        node.report(node.tasks(actuator_id))

    def resume(self, description: ActuatorDescription, outlook: Outlook) -> None:
        """Publish what the history of a unit says of it."""
        with self.lock:
            unit = self.get(description.actuator_id)
            if unit is None or not self._node.is_active:
                return
            outlook = self._claimed(unit, outlook)
            change = unit.resume(description, outlook, self.now())
        self._follow(description, None if change is None else outlook, change)
        self._node.report(self._node.tasks(description.actuator_id))

    def worth(self, description: ActuatorDescription, outlook: Outlook) -> Outlook:
        """Return what an outlook of a unit that is mounted is worth at this time."""
        with self.lock:
            unit, now = self[description.actuator_id], self.now()
            return unit.worth(self._claimed(unit, outlook), now)

    def _claimed(self, unit: Actuator, outlook: Outlook) -> Outlook:
        """Return an outlook that holds as long as the tests of the unit require."""
        good_for_s = unit.good_for_s(self._node.operation.value)
        return replace(outlook, claim=outlook.claim._replace(good_for_s=good_for_s))

    def tell(self, actuator_id: str, events: tuple[UnitEvent, ...]) -> None:
        """Publish the health of an actuator as it is, with events."""
        with self.lock:
            unit = self.get(actuator_id)
            if unit is not None and self._node.is_active:
                unit.tell(events)

    def _follow(
        self, description: ActuatorDescription, outlook: Outlook | None, change: str | None
    ) -> None:
        """Log a change of the level, and have published what follows from a health."""
        if change:
            self._node.get_logger().info(f"{description.actuator_id}: {change}")
        # Only now: it may wait for a prognosis of another thread, and health must not.
        if outlook and (forecaster := self._node.prognosis.forecaster(description, outlook)):
            self._node.follow_ups.follow_health(description, forecaster)

    def get_or_add(
        self, actuator_id: str, description: ActuatorDescription | None = None
    ) -> Actuator | None:
        """Return an actuator; None when there is no room: its description is kept for later."""
        if (unit := self.get(actuator_id)) is not None:
            return unit
        if (reason := self.admission.refuse(actuator_id, self)) is not None:
            if description is not None:
                self._remember(description)
            if reason:
                self._node.warn(actuator_id, reason, is_first=True)
            return None
        node = self._node
        node.add_publishers(actuator_id)
        unit = Actuator(
            self._intake_of(actuator_id),
            node.publish_health,
            self.now().steady_ns,
            node.unit_namespace,
        )
        unit.is_listed = actuator_id in self.admission.listed
        self[actuator_id] = unit
        if (known := self._described.pop(actuator_id, None)) is not None and description is None:
            unit.intake.describe(known)
            self._prepare(known)
        return unit

    def _intake_of(self, actuator_id: str) -> Intake:
        """Return a new intake of an actuator, which shares what was received before it is known."""
        return Intake(
            actuator_id,
            self._trigger,
            measurements=self._measurements,
            counts=self._counts,
            max_age_s=lambda: self._node.operation.value.measured_max_age_s,
        )

    def _remember(self, description: ActuatorDescription) -> None:
        """Keep the description of an actuator that is not monitored."""
        self._described.pop(description.actuator_id, None)
        self._described[description.actuator_id] = description
        if len(self._described) > _MOST_DESCRIBED:
            del self._described[next(iter(self._described))]

    def _in_words(self) -> str:
        names = list(self)
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        return (", ".join(names[:_MOST_NAMED]) or "none") + more

    def _not_monitored(self, actuator_id: str) -> str:
        reason = self.admission.why_not(actuator_id) or f"monitored: {self._in_words()}"
        return f"actuator_id = {actuator_id!r} is not monitored; {reason}"


def _cut_off(segment: Segment) -> Segment:
    """Return the refusal of a window, or of a record that the monitor stops within."""
    window = segment.window
    if isinstance(window, Refusal):
        return segment
    reason = "the monitor was stopped within the record"
    return replace(segment, window=Refusal(window.start_ns, window.end_ns, reason, is_cut_off=True))
