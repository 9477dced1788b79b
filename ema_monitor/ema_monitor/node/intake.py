"""What a monitor receives of its actuators: windows of it are queued, and what is wrong told."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from ema_core.description import ActuatorDescription, check_name
from ema_core.telemetry import Telemetry
from ema_monitor.model.measurements import MeasurementLog
from ema_monitor.node.actuator import Actuator
from ema_monitor.node.actuators import Actuators
from ema_monitor.prognosis.duty.meter import DutyLog
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.trigger import Defect, TriggerSettings
from ema_monitor.windows.window import Window
from ema_ros.messages import description_from_message, measured_from_message, telemetry_from_message
from ema_ros.stamps import stamp_from_message

_MOST_MEASUREMENTS = 10_000


class Intake:
    """Takes descriptions, telemetry and measured causes of the actuators that are followed.

    Parameters
    ----------
    units
        The actuators.
    queue_window
        Called with each window, or its refusal.
    max_age_s
        Gives the age up to which what was measured holds for a window [s].
    duties
        Sums up the duty that telemetry tells.
    """

    def __init__(
        self,
        units: Actuators,
        queue_window: Callable[[Segment], None],
        max_age_s: Callable[[], float],
        duties: DutyLog,
    ) -> None:
        self._units = units
        self._queue_window = queue_window
        self._max_age_s = max_age_s
        self._measurements = MeasurementLog(_MOST_MEASUREMENTS)
        self._duties = duties

    def clear(self) -> None:
        """Forget what was measured."""
        self._measurements.clear()

    def forget(self, actuator_id: str) -> None:
        """Forget what was measured of an actuator."""
        with self._units.lock:
            self._measurements.forget(actuator_id)
            self._duties.forget(actuator_id)

    def receive_description(self, message: Any) -> None:
        """Apply ``ema_interfaces/msg/ActuatorDescription``, which may be impossible."""
        if self._units.admission.ignores(message.actuator_id):
            return
        try:
            self.describe(description_from_message(message))
        except ValueError as error:
            reason = f"the description is impossible: {error}"
            is_name = _is_name(message.actuator_id)
            self._units.add_defect(message.actuator_id, reason, is_known=is_name)

    def describe(self, description: ActuatorDescription) -> None:
        """Apply the description of an actuator, if it is followed."""
        with self._units.lock:
            unit = self._units.get_or_add(description.actuator_id, description)
            if unit is None:
                return
            before = unit.description
            self._handle(unit, unit.finder.describe(description))
            if before is not None and before.serial_number != description.serial_number:
                unit.reset_health(self._units.now_ns())
                if unit.exchange(before.serial_number, description.serial_number):
                    self._units.warn(unit.actuator_id, unit.alternation, True)
        if before != description:
            self._units.note_description(description)

    def receive_telemetry(self, message: Any) -> None:
        """Look for windows in ``ema_interfaces/msg/TelemetryBlock``, which may be impossible."""
        actuator_id = message.actuator_id
        if not actuator_id:
            self._units.add_defect("", "telemetry without actuator_id")
            return
        if actuator_id not in self._units:
            if not _is_name(actuator_id):
                reason = "telemetry with an impossible actuator_id"
                self._units.add_defect(actuator_id, reason, is_known=False)
                return
            if self._units.admission.ignores(actuator_id):
                return
        with self._units.lock:
            unit = self._units.get_or_add(actuator_id)
            if unit is None:
                return
            unit.hear(self._units.now_ns())
            try:
                block = telemetry_from_message(message)
            except ValueError as error:
                stamp_ns = stamp_from_message(message.header.stamp)
                events = unit.finder.reject(stamp_ns, str(error))
            else:
                self._note_duty(unit, block)
                events = unit.finder.feed(block)
            if unit.finder.blocks == 1:
                self._units.inform(f"{actuator_id}: first telemetry")
            self._handle(unit, events)

    def _note_duty(self, unit: Actuator, block: Telemetry) -> None:
        """Add a block to the duty of a unit, once that is described."""
        if unit.description is not None:
            rise = self._measurements.winding_rise(
                unit.actuator_id, block.stamp_ns, self._max_age_s()
            )
            self._duties.add(unit.description.unit_key, block, unit.description.parameters, rise)

    def receive_measured(self, message: Any) -> None:
        """Keep ``ema_interfaces/msg/MeasuredCauses``, which may be impossible."""
        actuator_id = message.actuator_id
        if not actuator_id:
            self._units.add_defect("", "measured causes without actuator_id")
            return
        if self._units.admission.ignores(actuator_id):
            return
        try:
            stamp_ns, measured = measured_from_message(message)
            with self._units.lock:
                self._measurements.add(actuator_id, stamp_ns, measured)
        except ValueError as error:
            # A measurement alone does not make an actuator known.
            self._units.add_defect(actuator_id, str(error), is_known=actuator_id in self._units)

    def restart(self, settings: TriggerSettings) -> None:
        """Look for windows with other settings from now on; a window that is open is refused."""
        with self._units.lock:
            self._units.trigger = settings
            for unit in self._units.values():
                events = unit.finder.restart(settings, "the settings of the window changed")
                # Nothing is wrong where no window is cut off.
                self._handle(unit, [event for event in events if isinstance(event, Segment)])

    def finish(self) -> list[Segment]:
        """End the telemetry of all; return the refusals of the windows that are cut off."""
        with self._units.lock:
            events = [event for unit in self._units.values() for event in unit.finder.finish()]
        return [event for event in events if isinstance(event, Segment)]

    def _handle(self, unit: Actuator, events: Iterable[Segment | Defect]) -> None:
        """Queue windows for identification, and report defects."""
        for event in events:
            if isinstance(event, Defect):
                self._units.add_defect(unit.actuator_id, event.reason)
                continue
            self._duties.cut(event.description.unit_key, event.window.end_ns)
            if isinstance(event.window, Window):
                measured = self._measurements.at(
                    unit.actuator_id, event.window.start_ns, self._max_age_s()
                )
                event = replace(event, window=replace(event.window, measured=measured))
                unit.latest = event
            self._queue_window(event)


def _is_name(actuator_id: str) -> bool:
    try:
        check_name("actuator_id", actuator_id)
    except ValueError:
        return False
    return True
