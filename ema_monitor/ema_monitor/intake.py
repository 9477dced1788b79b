"""Intake of one actuator: telemetry, measurements and counts in; windows and use of units out.

The node, `Monitor`, the commands for bags and the archive use the same one.
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
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import Defect, TriggerSettings
from ema_monitor.windows.window import Window

if TYPE_CHECKING:  # an estimate alone needs no prognosis
    from ema_monitor.prognosis.duty.damage import FlownDuty
    from ema_monitor.prognosis.duty.meter import DutyMeter
    from ema_monitor.prognosis.history_entry import Count
    from ema_monitor.prognosis.service import CountLog

MOST_MEASUREMENTS: Final = 10_000
"""Measurements of a cause that are kept while telemetry comes without end."""

MOST_PIECES: Final = 1000
"""Windows whose duty is kept apart while telemetry comes without end."""

_MOST_UNITS: Final = 10


class Use(NamedTuple):
    """Use of a unit up to a test: the latest count of service life, and the duty flown."""

    counted: "Count | None"
    flown: "FlownDuty"


class Intake:
    """Takes in what is received of one actuator.

    Windows have the measured causes that hold for them. The duty in all telemetry of a unit, and
    the counts of its service life, are kept until a test of the unit takes them.

    Parameters
    ----------
    actuator_id
        Name of the actuator, by which it is measured.
    settings
        When a window begins and how long it is.
    description
        The actuator, if that is known already.
    measurements, counts
        Logs that the actuator shares with others; its own ones when None.
    measured
        Causes that were measured throughout, each in the place of what the log has.
    max_age_s
        Returns the age at the start of a window up to which a measurement holds for it [s].
    most_pieces
        Windows of a unit whose duty is kept apart, the latest ones; None for all, of any number of
        units.
    measures_duty
        Whether to measure duty, for which a kernel is compiled.

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
        # The units that have been in the place of the actuator, the latest last.
        self._meters: dict[UnitKey, DutyMeter] = {}

    def describe(self, description: ActuatorDescription) -> list[Segment | Defect]:
        """Apply a description, as of `WindowFinder.describe`; early counts are of its unit."""
        if description == self.finder.description:
            return []
        if self._counts is not None:
            self._counts.assign(description.unit_key)
        return self._complete(self.finder.describe(description))

    def restart(self, settings: TriggerSettings, reason: str) -> list[Segment | Defect]:
        """Begin anew with other settings, as of `WindowFinder.restart`."""
        return self._complete(self.finder.restart(settings, reason))

    def feed(self, block: Telemetry) -> list[Segment | Defect]:
        """Take in the next block; return the windows that it completes and its defects."""
        described = self.finder.description
        if self._measures_duty and described is not None:
            rise = self._measurements.winding_rise(
                self.actuator_id, block.stamp_ns, self._max_age_s()
            )
            self._meter_of(described.unit_key).add(block, described.parameters, rise)
        return self._complete(self.finder.feed(block))

    def reject(self, stamp_ns: int, reason: str) -> list[Segment | Defect]:
        """Take in a block that is no valid telemetry, as of `WindowFinder.reject`."""
        return self._complete(self.finder.reject(stamp_ns, reason))

    def split(self, block: Telemetry) -> list[Segment | Defect]:
        """End the telemetry so far if a block does not continue it, as of `WindowFinder.split`."""
        return self._complete(self.finder.split(block))

    def finish(self) -> list[Segment | Defect]:
        """End the telemetry; return the record that ends there, or the refusal of a window."""
        return self._complete(self.finder.finish())

    def measure(self, stamp_ns: int, measured: Mapping[str, tuple[float, float]]) -> None:
        """Keep what was measured at a time [ns]; arguments and errors as of `measured_causes`."""
        self._measurements.add(self.actuator_id, stamp_ns, measured_causes(measured))

    def count(self, unit: UnitKey, count: "Count") -> None:
        """Keep a count of the service life of a unit; it holds for tests after its stamp."""
        from ema_monitor.prognosis.service import CountLog

        self._counts = self._counts or CountLog()
        self._counts.add(unit, count)

    def take_use(self, unit: UnitKey, end_ns: int) -> Use:
        """Return the use of a unit up to a test that ends at a stamp [ns]; its duty only once."""
        from ema_monitor.prognosis.duty.damage import NOTHING_FLOWN

        meter = self._meters.get(unit)
        flown = NOTHING_FLOWN if meter is None else meter.take(end_ns)
        counted = None if self._counts is None else self._counts.latest(unit, end_ns)
        return Use(counted, flown)

    def pieces(self, end_ns: int) -> dict[UnitKey, "list[tuple[int, FlownDuty]]"]:
        """Return the duty by unit up to the end of each window, and to a stamp, by stamps [ns]."""
        for meter in self._meters.values():
            meter.cut(end_ns)
        return {unit: list(meter.pieces) for unit, meter in self._meters.items()}

    def _complete(self, events: Iterable[Segment | Defect]) -> list[Segment | Defect]:
        """Return windows with their measured causes, and assign the duty up to them."""
        return [self._with_use(one) if isinstance(one, Segment) else one for one in events]

    def _with_use(self, segment: Segment) -> Segment:
        window = segment.window
        if self._measures_duty:
            self._meter_of(segment.description.unit_key).cut(window.end_ns)
        if not isinstance(window, Window):
            return segment
        known = self._measurements.at(self.actuator_id, window.start_ns, self._max_age_s())
        if self._measured:
            every = {one.name: (one.value, one.sigma) for one in (*known, *self._measured)}
            known = measured_causes(every)
        return replace(segment, window=replace(window, measured=known))

    def _meter_of(self, unit: UnitKey) -> "DutyMeter":
        from ema_monitor.prognosis.duty.meter import DutyMeter  # the compiler only for it

        meter = self._meters.pop(unit, None) or DutyMeter(deque(), self._most_pieces)
        self._meters[unit] = meter
        if self._most_pieces and len(self._meters) > _MOST_UNITS:
            del self._meters[next(iter(self._meters))]
        return meter
