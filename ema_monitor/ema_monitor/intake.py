# SPDX-License-Identifier: Apache-2.0
"""Intake of one actuator: finds windows and adds up service life, from telemetry and counts.

The node, `Monitor`, the commands that read bags and the archive all use it.
"""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

from ema_core.causes import CauseEstimate
from ema_core.description import ActuatorDescription, UnitKey
from ema_core.telemetry import Telemetry
from ema_monitor.model.measured import measured_causes
from ema_monitor.model.measurements import MAX_AGE_S, MeasurementLog
from ema_monitor.reasons import Reason
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import Defect, TriggerSettings
from ema_monitor.windows.window import Window

if TYPE_CHECKING:  # an estimate alone needs no prognosis
    from ema_monitor.prognosis.duty.damage import FlownDuty
    from ema_monitor.prognosis.duty.meter import DutyMeter
    from ema_monitor.prognosis.history_entry import Count
    from ema_monitor.prognosis.service import CountLog

MOST_MEASUREMENTS: Final = 10_000
"""Largest number of measurements stored per cause in an endless telemetry stream."""

MOST_PIECES: Final = 1000
"""Largest number of windows with separately stored duty in an endless telemetry stream."""

_MOST_UNITS: Final = 10


class Use(NamedTuple):
    """Service life of a unit up to a test."""

    counted: "Count | None"
    """Latest count of service life; None without a count."""

    flown: "FlownDuty"
    """Duty accumulated since the previous test."""


class Intake:
    """Processes telemetry, measurements and counts of one actuator.

    Each window gets the measured causes that are valid at its start. The duty in all telemetry of a
    unit and its service-life counts are stored until a test of the unit takes them.

    Parameters
    ----------
    actuator_id
        Name of the actuator in the logs.
    settings
        Trigger settings: start condition and length of a window.
    description
        The actuator; None until it is described.
    measurements, counts
        Logs shared with other actuators; None for separate logs.
    measured
        Causes that are measured throughout; each replaces the measurements in the log.
    max_age_s
        Function that returns the largest age of a measurement at the start of a window [s].
    most_pieces
        Number of latest windows of a unit whose duty is stored separately; None for all windows of
        any number of units.
    measures_duty
        Whether to measure duty, which compiles a kernel.

    Attributes
    ----------
    actuator_id
        Name of the actuator.
    finder
        Finds the windows.
    """

    def __init__(
        self,
        actuator_id: str,
        settings: TriggerSettings,
        description: ActuatorDescription | None = None,
        *,
        measurements: MeasurementLog | None = None,
        counts: "CountLog | None" = None,
        measured: Sequence[CauseEstimate] = (),
        max_age_s: Callable[[], float] = lambda: MAX_AGE_S,
        most_pieces: int | None = MOST_PIECES,
        measures_duty: bool = True,
    ) -> None:
        self.finder = WindowFinder(settings, description)
        self.actuator_id = actuator_id
        self._measurements = measurements or MeasurementLog(MOST_MEASUREMENTS)
        self._counts = counts
        self._measured = measured
        self._max_age_s = max_age_s
        self._most_pieces = most_pieces
        self._measures_duty = measures_duty
        # By unit mounted as this actuator; the latest unit is last.
        self._meters: dict[UnitKey, DutyMeter] = {}

    def describe(self, description: ActuatorDescription) -> list[Segment | Defect]:
        """Apply a description (see `WindowFinder.describe`); assign earlier counts to its unit."""
        if description == self.finder.description:
            return []
        if self._counts is not None:
            self._counts.assign(description.unit_key)
        return self._complete(self.finder.describe(description))

    def restart(self, settings: TriggerSettings, cause: Reason) -> list[Segment | Defect]:
        """Restart the search for windows with new settings (see `WindowFinder.restart`)."""
        return self._complete(self.finder.restart(settings, cause))

    def feed(self, block: Telemetry) -> list[Segment | Defect]:
        """Process the next block. Return the completed windows and the defects of the block."""
        described = self.finder.description
        if self._measures_duty and described is not None:
            rise = self._measurements.winding_rise(
                self.actuator_id, block.stamp_ns, self._max_age_s()
            )
            self._meter_of(described.unit_key).add(block, described.parameters, rise)
        return self._complete(self.finder.feed(block))

    def reject(self, stamp_ns: int, error: str) -> list[Segment | Defect]:
        """Report a malformed block (see `WindowFinder.reject`)."""
        return self._complete(self.finder.reject(stamp_ns, error))

    def split(self, block: Telemetry) -> list[Segment | Defect]:
        """End the telemetry if a block does not continue it (see `WindowFinder.split`)."""
        return self._complete(self.finder.split(block))

    def finish(self) -> list[Segment | Defect]:
        """End the telemetry. Return its last record, or a refusal for an open window."""
        return self._complete(self.finder.finish())

    def measure(self, stamp_ns: int, measured: Mapping[str, tuple[float, float]]) -> None:
        """Add measured causes, each with value and standard deviation, at ``stamp_ns``.

        Raises
        ------
        ValueError
            If a cause is unknown or impossible (see `measured_causes`).
        """
        self._measurements.add(self.actuator_id, stamp_ns, measured_causes(measured))

    def count(self, unit: UnitKey, count: "Count") -> None:
        """Add a service-life count of a unit; it applies to later tests."""
        from ema_monitor.prognosis.service import CountLog

        self._counts = self._counts or CountLog()
        self._counts.add(unit, count)

    def take_use(self, unit: UnitKey, end_ns: int) -> Use:
        """Return the latest count of a unit and its duty since the last call, up to a test's end.

        Parameters
        ----------
        unit
            The unit.
        end_ns
            Stamp of the end of the test [ns].
        """
        from ema_monitor.prognosis.duty.damage import NOTHING_FLOWN

        meter = self._meters.get(unit)
        flown = NOTHING_FLOWN if meter is None else meter.take(end_ns)
        counted = None if self._counts is None else self._counts.latest(unit, end_ns)
        return Use(counted, flown)

    def pieces(self, end_ns: int) -> dict[UnitKey, "list[tuple[int, FlownDuty]]"]:
        """Return each unit's duty in pieces: one up to each window, and the last up to ``end_ns``.

        Returns
        -------
        dict
            By unit, pairs of the stamp of a piece's end [ns] and the duty since the previous piece.
        """
        for meter in self._meters.values():
            meter.cut(end_ns)
        return {unit: list(meter.pieces) for unit, meter in self._meters.items()}

    def _complete(self, events: Iterable[Segment | Defect]) -> list[Segment | Defect]:
        """Return events with measured causes added to windows; store the duty up to each window."""
        return [self._with_use(event) if isinstance(event, Segment) else event for event in events]

    def _with_use(self, segment: Segment) -> Segment:
        window = segment.window
        if self._measures_duty:
            self._meter_of(segment.description.unit_key).cut(window.end_ns)
        if not isinstance(window, Window):
            return segment
        causes = self._measurements.at(self.actuator_id, window.start_ns, self._max_age_s())
        if self._measured:
            causes = measured_causes(
                {cause.name: (cause.value, cause.sigma) for cause in (*causes, *self._measured)}
            )
        return replace(segment, window=replace(window, measured=causes))

    def _meter_of(self, unit: UnitKey) -> "DutyMeter":
        from ema_monitor.prognosis.duty.meter import DutyMeter  # imports the compiler

        meter = self._meters.pop(unit, None) or DutyMeter(deque(), self._most_pieces)
        self._meters[unit] = meter
        if self._most_pieces and len(self._meters) > _MOST_UNITS:
            del self._meters[next(iter(self._meters))]
        return meter
