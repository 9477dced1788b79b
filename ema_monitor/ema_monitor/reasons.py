# SPDX-License-Identifier: Apache-2.0
"""Typed reasons why there is no estimate, or why an estimate has reservations.

Programs use the kind of a reason, its ``code``. `ema_monitor.reason_texts` has the sentences for
people.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, fields
from enum import Enum, StrEnum
from typing import (
    Any,
    ClassVar,
    Final,
    NamedTuple,
    Self,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from ema_core.acquisition import Acquisition
from ema_core.columns.errors import ColumnError, Reference
from ema_core.columns.mistakes import FactorKind, Kind, Mistake

KINDS: Final[dict[str, type["Reason"]]] = {}
"""Classes of reasons by code."""

_LEAST_SHARE: Final = 0.05
"""Smallest probability at which a less probable labelled state is named [-]."""

_COUNTS: Final = ("stretches", "of_stretches")
_MESSAGES: Final = ("error", "sentence")
"""Fields with messages from elsewhere, whose figures and names vary."""


@dataclass(frozen=True, kw_only=True)
class Reason:
    """Reason for a missing estimate, or reservation about an estimate; a subclass per kind.

    A field is a number, name, flag or enum, a NamedTuple of them, or a tuple of any of these.
    """

    code: ClassVar[str]
    """Name of the kind."""
    stretches: int = 0
    of_stretches: int = 0
    """Number of stretches with this reason, and total number of stretches; 0 if not counted."""

    def __init_subclass__(cls, code: str) -> None:
        super().__init_subclass__()
        cls.code = code
        KINDS[code] = cls

    def as_record(self) -> dict[str, Any]:
        """Return code and figures as plain values: names for enums, a mapping for a NamedTuple."""
        names = [item.name for item in fields(self)]
        if not self.of_stretches:
            names = [name for name in names if name not in _COUNTS]
        return {"code": self.code} | {name: _plain(getattr(self, name)) for name in names}

    @property
    def kind(self) -> tuple[Any, ...]:
        """Code and names, which reasons that differ only in their figures have in common."""
        names = (item.name for item in fields(self) if item.name not in (*_COUNTS, *_MESSAGES))
        return (self.code, *(_without_figures(getattr(self, name)) for name in names))

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> "Reason":
        """Return the reason for the output of ``as_record``, also after a JSON round trip.

        Raises
        ------
        ValueError, KeyError, TypeError
            If ``record`` does not describe a reason.
        """
        values = dict(record)
        code = values.pop("code")
        if code not in KINDS:
            raise ValueError(f"code = {code!r}: expected one of {', '.join(KINDS)}")
        return KINDS[code]._read(values)

    @classmethod
    def _read(cls, values: dict[str, Any]) -> Self:
        types = get_type_hints(cls)
        return cls(**{name: _read_as(types[name], value) for name, value in values.items()})


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, tuple):
        names: tuple[str, ...] = getattr(value, "_fields", ())
        items = list(map(_plain, value))
        return dict(zip(names, items, strict=True)) if names else items
    return value


def _read_as(kind: Any, value: Any) -> Any:
    """Return a value of a type from the output of ``_plain``; a float may be None for NaN."""
    if kind is float:
        return math.nan if value is None else float(value)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind(value)
    if isinstance(kind, type) and hasattr(kind, "_fields"):
        types = get_type_hints(kind)
        return kind(**{name: _read_as(types[name], item) for name, item in value.items()})
    if get_origin(kind) is tuple and (types := get_args(kind))[1:] == (Ellipsis,):
        return tuple(_read_as(types[0], item) for item in value)
    return _as_tuple(value)


def _as_tuple(value: Any) -> Any:
    return tuple(map(_as_tuple, value)) if isinstance(value, list | tuple) else value


def _without_figures(value: Any) -> Any:
    """Return a value without its numbers."""
    if isinstance(value, tuple):
        return tuple(map(_without_figures, value))
    return value if isinstance(value, bool | str) else None


def codes(reasons: Iterable[Reason]) -> tuple[str, ...]:
    """Return the unique codes of reasons, in order."""
    return tuple(dict.fromkeys(reason.code for reason in reasons))


# The window, its telemetry, and its place among the tests of a unit.


@dataclass(frozen=True)
class SamplesLost(Reason, code="samples_lost"):
    """Samples are missing between two blocks."""

    expected: int
    index: int
    """Index of the first missing sample, and of the next received sample."""


@dataclass(frozen=True)
class IndexWentBack(Reason, code="index_went_back"):
    """The sample index went back, for example because two publishers send the telemetry."""

    latest: int
    index: int
    """Index of the latest sample, and of the sample after it."""


@dataclass(frozen=True)
class TimeWentBack(Reason, code="time_went_back"):
    """The stamp of a block is earlier than the stamp of the block before it."""

    back_s: float
    """Time by which the stamp went back [s]."""
    index: int
    """Index of the first sample of the block."""


@dataclass(frozen=True)
class PeriodChanged(Reason, code="period_changed"):
    """The sample period [s] changed between two blocks."""

    before: float
    period: float


@dataclass(frozen=True)
class ColumnsChanged(Reason, code="columns_changed"):
    """The measured columns changed between two blocks."""

    missing: tuple[str, ...]
    """Columns that are not measured from ``index`` on."""
    missing_before: tuple[str, ...]
    """Columns that were not measured before."""
    index: int
    """Index of the first sample of the block."""


@dataclass(frozen=True)
class PayloadChanged(Reason, code="payload_changed"):
    """The payload is known only before a sample, or only from a sample on."""

    is_known: bool
    """Whether the payload is known from ``index`` on."""
    index: int
    """Index of this sample."""


@dataclass(frozen=True)
class StampsOffPeriod(Reason, code="stamps_off_period"):
    """The stamps of blocks contradict their sample period. Periods in s."""

    stamped: float
    period: float


@dataclass(frozen=True)
class OtherPeriod(Reason, code="other_period"):
    """The sample period of the telemetry differs from the description. Periods in s."""

    described: float
    period: float


@dataclass(frozen=True)
class SamplesNotFinite(Reason, code="samples_not_finite"):
    """Samples of a column are not finite, or too large for computation."""

    column: str
    value: float
    index: int
    """First such sample: its value and index."""
    samples: int
    """Number of such samples in the block."""
    largest: float
    """Largest usable value; NaN if the samples are not finite."""


@dataclass(frozen=True)
class ImpossibleSamples(Reason, code="impossible_samples"):
    """The described motor cannot produce some samples."""

    jumps: int
    largest_jump: float
    possible_jump: float
    """Number of jumps of the position, the largest, and the largest possible in a period [rad]."""
    period: float
    """Sample period [s]."""
    spikes: int
    largest_spike: float
    possible_spike: float
    """Number of wrong samples of the speed, their largest error, and the largest possible change in
    a period [rad/s]."""


@dataclass(frozen=True)
class TooManySamples(Reason, code="too_many_samples"):
    """A window or record of the required length would have too many samples."""

    period: float
    """Sample period [s]."""
    length_s: float
    samples: int
    most: int
    """Required length [s], its number of samples, and the largest possible number."""
    is_record: bool
    """Whether a record would have them; else a window."""


@dataclass(frozen=True)
class TooManyBlocks(Reason, code="too_many_blocks"):
    """A window has more than ``most`` blocks."""

    most: int


@dataclass(frozen=True)
class TelemetryEnded(Reason, code="telemetry_ended"):
    """The telemetry ended before the window was complete."""

    after_s: float
    """Time from the start of the window to the end of the telemetry [s]."""
    window_s: float
    """Length of a window [s]."""


@dataclass(frozen=True)
class MalformedBlock(Reason, code="malformed_block"):
    """A block of telemetry cannot be read."""

    error: str
    """Message of the reader."""


@dataclass(frozen=True)
class DescriptionChanged(Reason, code="description_changed"):
    """The description of the actuator changed during the window."""


@dataclass(frozen=True)
class SettingsChanged(Reason, code="settings_changed"):
    """The settings of the window changed during the window."""


class Stage(StrEnum):
    """Stage of a window or record."""

    RECORD = "record"
    """It is being recorded."""
    QUEUE = "queue"
    """It waits for its identification."""
    IDENTIFICATION = "identification"
    """It is being identified."""


@dataclass(frozen=True)
class MonitorStopped(Reason, code="monitor_stopped"):
    """The monitor was stopped before the window was identified."""

    stage: Stage
    """Stage of the window or record when the monitor was stopped."""


@dataclass(frozen=True)
class MonitorInactive(Reason, code="monitor_inactive"):
    """The monitor is not active."""


@dataclass(frozen=True)
class QueueFull(Reason, code="queue_full"):
    """The window was dropped because more than ``most`` windows or stretches waited."""

    most: int
    is_stretch: bool


@dataclass(frozen=True)
class IdentificationFailed(Reason, code="identification_failed"):
    """The identification ended with an error."""

    error: str
    """Message of the error."""


@dataclass(frozen=True)
class OrderUnknown(Reason, code="order_unknown"):
    """The order of the tests is unknown: the stamp of a test is not later than the newest stamp."""

    before_s: float
    """Time from this stamp to the newest stamp [s]. A value of 0 or less means that a different
    test has the same stamp."""


@dataclass(frozen=True)
class StampsContradict(Reason, code="stamps_contradict"):
    """The stamps of recordings do not show which test came first."""

    bags: tuple[str, ...]
    """Recordings with different tests at the same time, or the recording whose clock went back."""
    back_s: float
    """Time by which the clock went back between two tests [s]; 0 if tests are at the same time."""
    end_s: float
    """Earlier end of the tests at the same time [s]; NaN if the clock went back."""
    has_date: bool
    """Whether the stamps are dates."""


@dataclass(frozen=True)
class NotMeasured(Reason, code="not_measured"):
    """The telemetry lacks a column."""

    column: str


@dataclass(frozen=True)
class FitnessNeedsCurrent(Reason, code="fitness_needs_current"):
    """``fitness`` compares currents, but no current is measured; ``usable`` can be used instead."""

    fitness: str
    usable: str


@dataclass(frozen=True)
class EffortMissing(Reason, code="effort_missing"):
    """A record of an unknown drive has neither current nor torque."""


@dataclass(frozen=True)
class PayloadMissing(Reason, code="payload_missing"):
    """The payload is unknown, but only motion without a payload can be compared."""


@dataclass(frozen=True)
class SpeedGaps(Reason, code="speed_gaps"):
    """The speed of a record is not measured in some samples."""


@dataclass(frozen=True)
class NoTravel(Reason, code="no_travel"):
    """The commanded travel [rad] is too small to excite the faults."""

    travel: float
    least: float


@dataclass(frozen=True)
class MotorStill(Reason, code="motor_still"):
    """The motor stands still although the command moves."""


class Subject(StrEnum):
    """Telemetry that an estimate describes."""

    WINDOW = "window"
    STRETCH = "stretch"
    """Stretch of ordinary motion."""
    MOTION = "motion"
    """Several stretches of ordinary motion, combined."""


@dataclass(frozen=True)
class NotDetermined(Reason, code="not_determined"):
    """The window, stretch or motion (``subject``) narrows no fault below its prior range."""

    subject: Subject


# Telemetry without a window or record.


@dataclass(frozen=True)
class CommandMissing(Reason, code="command_missing"):
    """The telemetry of a modelled drive lacks the position command, which delimits windows."""


@dataclass(frozen=True)
class RunTooShort(Reason, code="run_too_short"):
    """The telemetry without a gap is too short for a window or record."""

    period: float
    """Sample period [s]."""
    length_s: float
    samples: int
    """Shortest length of a window or record [s], and its number of samples."""
    longest: int
    """Largest number of samples without a gap."""
    lost: int
    """Number of lost samples."""
    is_record: bool
    """Whether records are sought; else windows."""


@dataclass(frozen=True)
class PieceTooShort(Reason, code="piece_too_short"):
    """The longest motion is too short for a record. Times in s."""

    longest_s: float
    least_s: float


@dataclass(frozen=True)
class TravelTooSmall(Reason, code="travel_too_small"):
    """The travel of the position [rad] is too small for a record."""

    travel: float
    least: float


@dataclass(frozen=True)
class CommandTravelTooSmall(Reason, code="command_travel_too_small"):
    """The command never travels ``least`` [rad] within a window."""

    window_s: float
    """Length of a window [s]."""
    least: float


@dataclass(frozen=True)
class MotionTooShort(Reason, code="motion_too_short"):
    """The longest motion after a rest is shorter than a window. Times in s."""

    window_s: float
    rest_s: float
    longest_s: float


@dataclass(frozen=True)
class NeverAtRest(Reason, code="never_at_rest"):
    """The command never rested."""

    rest_s: float
    threshold: float
    """A rest: the command stays within ``threshold`` [rad] for ``rest_s`` [s]."""
    seen_s: float
    """Length of the telemetry [s]."""


# The calibration.


Difference = tuple[str, str | float, str | float]
"""Name of a property, its value of the actuator, and its value in the calibration."""


@dataclass(frozen=True)
class NoCalibration(Reason, code="no_calibration"):
    """There is no calibration yet: its file does not exist."""

    file: str
    """Path or address of the file."""


@dataclass(frozen=True)
class CalibrationUnusable(Reason, code="calibration_unusable"):
    """The calibration file cannot be read, or is not a calibration."""

    error: str
    """Message of the reader, with the file."""


@dataclass(frozen=True)
class BaselineUnusable(Reason, code="baseline_unusable"):
    """The learned baseline of the unit cannot be read or written."""

    error: str
    """Message of the operating system or reader."""


CalibrationMissing = NoCalibration | CalibrationUnusable
"""Reason why an actuator has no calibration."""


@dataclass(frozen=True)
class Learning(Reason, code="learning"):
    """The healthy records of the unit are being collected; it has no baseline yet."""

    records: int
    days: int
    """Number of collected records, and of their days."""
    records_needed: int
    """Number of records for automatic acceptance; 0 if a person accepts."""
    same_day: float
    other_day: float
    """Smallest relative change of friction that would show on a day with records, and on another
    day [-]; NaN before the first fit."""
    detail: str
    """Why the records make no baseline; empty if they make one."""


@dataclass(frozen=True)
class DriveUnknown(Reason, code="drive_unknown"):
    """The drive is unknown, and the calibration belongs to a known drive."""


@dataclass(frozen=True)
class OtherUnit(Reason, code="other_unit"):
    """The calibration does not fit the actuator. If ``forced``, an estimate was made anyway."""

    differences: tuple[Difference, ...]
    forced: bool = False


@dataclass(frozen=True)
class OtherSamples(Reason, code="other_samples"):
    """The sample period [s] differs from the period in the calibration of ``unit``."""

    period: float
    calibrated: float
    unit: tuple[str, str]
    """Actuator and serial number."""


@dataclass(frozen=True)
class PeriodTooLong(Reason, code="period_too_long"):
    """The sample period of a record is too long for the healthy records. Periods in s."""

    period: float
    longest: float


@dataclass(frozen=True)
class ColumnsContradict(Reason, code="columns_contradict"):
    """Columns are empty or filled although the acquisition states the opposite."""

    empty: tuple[str, ...]
    filled: tuple[str, ...]
    acquisition: str
    """The acquisition of the calibration, as messages name it."""

    @classmethod
    def of(cls, acquisition: Acquisition, missing: Collection[str]) -> Self | None:
        """Return the reason why empty columns contradict an acquisition; None if they do not."""
        empty, filled = acquisition.contradicting(missing)
        return cls(empty, filled, str(acquisition)) if empty or filled else None


# Failures and mistakes shown by the telemetry.


@dataclass(frozen=True)
class Jam(Reason, code="jam"):
    """Blocked shaft: the motor stands still while current [A] flows."""

    current: float


@dataclass(frozen=True)
class OpenCircuit(Reason, code="open_circuit"):
    """Dead switch or open phase: almost none of the commanded current [A] flows."""

    wanted: float
    current: float


@dataclass(frozen=True)
class JamOrOpenCircuit(Reason, code="jam_or_open_circuit"):
    """The motor stands still despite a commanded current [A]; the current is not measured."""

    wanted: float


@dataclass(frozen=True)
class DeadSensor(Reason, code="dead_sensor"):
    """Dead sensor: ``column`` is constant although the column ``moving`` changes."""

    column: str
    value: float
    moving: str


MistakeRow = tuple[str, float, str, str]
"""Kind, factor, actual and stated unit of a common mistake; see ``ema_core.columns``."""


def mistake_row(mistake: Mistake) -> MistakeRow:
    """Return a mistake as plain values."""
    return mistake.kind.value, mistake.factor, mistake.unit, mistake.stated


def mistake_of(row: MistakeRow) -> Mistake:
    """Return the mistake for the output of ``mistake_row``."""
    kind, factor, unit, stated = row
    return Mistake(cast("FactorKind", Kind(kind)), factor, unit, stated)


@dataclass(frozen=True)
class WrongScale(Reason, code="wrong_scale"):
    """Columns differ by a constant factor [-] from their expected values.

    ``reference`` names the source of the expected values. ``mistakes`` lists common mistakes that
    together explain the factor; it is empty if none do.
    """

    columns: tuple[str, ...]
    factor: float
    reference: Reference
    mistakes: tuple[MistakeRow, ...]

    @classmethod
    def of(cls, error: ColumnError) -> Self:
        """Return the reason that reports a wrong column."""
        mistakes = tuple(map(mistake_row, error.mistakes))
        return cls(error.columns, error.factor, error.reference, mistakes)

    @property
    def error(self) -> ColumnError:
        """The wrong column."""
        mistakes = tuple(map(mistake_of, self.mistakes))
        return ColumnError(self.columns, self.factor, self.reference, mistakes)


# The search and its fit.


@dataclass(frozen=True)
class NoFiniteCost(Reason, code="no_finite_cost"):
    """No fault vector has a finite cost."""


@dataclass(frozen=True)
class UncertaintyUnknown(Reason, code="uncertainty_unknown"):
    """The covariance cannot be computed."""

    error: str
    """Message of the linear algebra."""


@dataclass(frozen=True)
class NotConverged(Reason, code="not_converged"):
    """The search was stopped before it converged."""


@dataclass(frozen=True)
class Contradicted(Reason, code="contradicted"):
    """A measured cause was ignored because the window, stretch or motion contradicts it."""

    subject: Subject
    name: str
    value: float
    sigma: float


@dataclass(frozen=True)
class CauseFound(Reason, code="cause_found"):
    """A hidden cause is part of the explanation, ``low`` to ``high`` over the stretches.

    ``low`` and ``high`` are NaN for a single window or stretch.
    """

    name: str
    value: float
    sigma: float
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True)
class SensorBeyondRange(Reason, code="sensor_beyond_range"):
    """A sensor error is at a bound of the search range."""

    name: str
    value: float
    sigma: float


@dataclass(frozen=True)
class NotSeparated(Reason, code="not_separated"):
    """A part of the explanation cannot be separated from the listed alternatives."""

    subject: Subject
    part: tuple[str, ...]
    stand_ins: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class FitUnjudged(Reason, code="fit_unjudged"):
    """The calibration lacks the scatter needed to judge the fit."""

    calibration_windows: int


@dataclass(frozen=True)
class PoorFit(Reason, code="poor_fit"):
    """The residual is larger than expected, but mostly explained."""

    goodness: float
    limit: float
    unexplained_share: float


@dataclass(frozen=True)
class Unexplained(Reason, code="unexplained"):
    """Neither faults nor hidden causes explain a window, stretch or motion."""

    subject: Subject
    goodness: float
    limit: float
    unexplained_share: float


# Stretches of ordinary motion, combined.


@dataclass(frozen=True)
class MotionEnded(Reason, code="motion_ended"):
    """The motion ended before every fault reached the target accuracy."""


@dataclass(frozen=True)
class MotionDisagrees(Reason, code="motion_disagrees"):
    """The subsequent motion does not agree with the stretches combined before."""


@dataclass(frozen=True)
class FaultsNotShown(Reason, code="faults_not_shown"):
    """The motion does not determine some faults to the target accuracy."""

    faults: tuple[str, ...]


@dataclass(frozen=True)
class StretchesInsufficient(Reason, code="stretches_insufficient"):
    """The stretches do not determine the faults to the target accuracy."""


@dataclass(frozen=True)
class StatedReason(Reason, code="stated"):
    """A message states the reason as a sentence, without its kind and figures."""

    sentence: str


# Comparison with the windows and records of the healthy unit.


class DepartedFigure(NamedTuple):
    """Figure of a window that departs from the healthy windows."""

    name: str
    ratio: float
    """Measured over healthy value [-]; NaN for a level with a healthy value of 0 or less."""
    value: float = math.nan
    healthy: float = math.nan
    """Measured and healthy value of a level [A]; NaN for other figures."""


@dataclass(frozen=True)
class FiguresDeparted(Reason, code="figures_departed"):
    """Figures of the window depart from healthy, and no fault explains the departure."""

    figures: tuple[DepartedFigure, ...]
    """Departed figures, most significant first."""
    probability: float
    """Probability that a healthy test differs by as much."""


class StateProbability(NamedTuple):
    """Probability of a state: healthy, a label, or none of these."""

    state: str
    probability: float


@dataclass(frozen=True)
class LabelledState(Reason, code="labelled_state"):
    """The window resembles these states, the most probable first."""

    states: tuple[StateProbability, ...]

    @property
    def probable(self) -> tuple[StateProbability, ...]:
        """The most probable state, and other states with a probability of at least 5 %."""
        first, *less = self.states
        return first, *(item for item in less if item.probability >= _LEAST_SHARE)

    @property
    def kind(self) -> tuple[Any, ...]:
        """Code and names of the probable states."""
        return (self.code, *(item.state for item in self.probable))


@dataclass(frozen=True)
class OtherMotion(Reason, code="other_motion"):
    """No labelled state is named: no healthy window has the motion of the window."""

    travel: float
    """Travel of the command, from end to end [rad]."""
    speed: float
    """99 % quantile of the commanded speed [rad/s]."""
    sample_period: float
    """Period of the samples [s]."""


@dataclass(frozen=True)
class OtherLoad(Reason, code="other_load"):
    """No labelled state is named: the load is ``away`` [A] from healthy and labelled windows."""

    away: float


@dataclass(frozen=True)
class TooFewHealthy(Reason, code="too_few_healthy"):
    """No labelled state is named: fewer than ``least`` healthy windows have the load."""

    least: int


@dataclass(frozen=True)
class TooFewLabelled(Reason, code="too_few_labelled"):
    """No labelled state is named: no state has ``least`` tests of this motion and load."""

    least: int


StateUnnamed = OtherMotion | OtherLoad | TooFewHealthy | TooFewLabelled
"""Reason why no labelled state is named."""


@dataclass(frozen=True)
class WouldDepart(Reason, code="would_depart"):
    """A figure differs by an amount that would depart on a day with healthy tests."""

    figure: str
    """Name of the figure."""
    change: float
    """Measured minus healthy value, relative to the healthy value [-]; if not ``is_relative``, in
    A."""
    smallest_change: float
    """Smallest change that departs on a day without healthy tests, in the unit of ``change``."""
    is_relative: bool
    """Whether the changes are relative; false for a level with a healthy value of 0 or less."""


class Unjudged(StrEnum):
    """Cause why a quantity of a record is neither changed nor unchanged."""

    NO_GRAVITY = "no_gravity"
    """The healthy records show no gravity."""
    LITTLE_ACCELERATION = "little_acceleration"
    """The healthy records accelerate too little."""
    ONE_SPEED = "one_speed"
    """The healthy records have nearly one speed."""
    ONLY_FRICTION = "only_friction"
    """The healthy records show only friction."""
    EFFORT_UNEXPLAINED = "effort_unexplained"
    """The motion does not explain a large part of the effort in the healthy records."""
    NO_SINGLE_CHANGE = "no_single_change"
    """It departs as well, and no single change explains the whole record."""
    DOUBTFUL = "doubtful"
    """The change is beyond usual variation, but not certain."""
    HARDLY_VISIBLE = "hardly_visible"
    """Friction or inertia is too small in the record."""
    NO_MOTOR_SIDE = "no_motor_side"
    """The healthy records lack motor speed, joint position or reversals."""
    PLAY_INVISIBLE = "play_invisible"
    """No play is visible in the healthy records."""
    FEW_REVERSALS = "few_reversals"
    """The record has too few reversals, or no measured speed."""
    PLAY_CLOSED = "play_closed"
    """A load closes the play."""
    COMMAND_STILL = "command_still"
    """The position command does not move enough."""
    NO_COMMAND = "no_command"
    """There is no position command."""
    HEALTHY_COMMAND_STILL = "healthy_command_still"
    """The position command of the healthy records does not move enough."""
    NO_HEALTHY_COMMAND = "no_healthy_command"
    """The healthy records have no position command."""


@dataclass(frozen=True)
class QuantityUnjudged(Reason, code="quantity_unjudged"):
    """A quantity of a record is not judged."""

    cause: Unjudged


@dataclass(frozen=True)
class QuantityInseparable(Reason, code="quantity_inseparable"):
    """A quantity is not judged: the motion cannot distinguish it from changed quantities."""

    changed: tuple[str, ...]
    """Names of the changed quantities."""


@dataclass(frozen=True)
class TooFewRows(Reason, code="too_few_rows"):
    """A record has too few rows of steady motion in one direction."""

    rows: int
    least: int


@dataclass(frozen=True)
class EffortConstant(Reason, code="effort_constant"):
    """The effort is constant although the joint moves."""

    effort: float


class Direction(StrEnum):
    """Direction of a stroke."""

    FORWARD = "forward"
    BACKWARD = "backward"


@dataclass(frozen=True)
class TooFewStrokes(Reason, code="too_few_strokes"):
    """A record has too few strokes forward or backward.

    ``is_empty`` states whether only strokes without a payload count.
    """

    strokes: int
    way: Direction
    least: int
    is_empty: bool = False


@dataclass(frozen=True)
class SpeedOutside(Reason, code="speed_outside"):
    """The ratio of the speed to the healthy records is outside the comparable range [-]."""

    ratio: float
    slowest: float
    fastest: float


@dataclass(frozen=True)
class SpeedScaled(Reason, code="speed_scaled"):
    """A column is ``factor`` times faster than in the healthy records: a common mistake."""

    column: str
    factor: float
    mistake: MistakeRow


@dataclass(frozen=True)
class EffortScaled(Reason, code="effort_scaled"):
    """The effort is ``factor`` times the healthy effort [-].

    ``mistake`` is () if no common mistake has this factor.
    """

    factor: float
    mistake: MistakeRow | tuple[()]


@dataclass(frozen=True)
class NegativeQuantity(Reason, code="negative_quantity"):
    """Friction or inertia of a record is below 0: ``ratio`` times the healthy value [-]."""

    name: str
    ratio: float


@dataclass(frozen=True)
class EffortReversed(Reason, code="effort_reversed"):
    """The effort has the opposite sign of the healthy records, or belongs to another joint."""


class StandstillCause(StrEnum):
    """Cause of a standstill under a moving command."""

    NO_EFFORT = "no_effort"
    """The effort is far below the friction: the drive is off, or a brake is applied."""
    SHORT_COMMAND = "short_command"
    """The command travels less than in the healthy records: the joint need not move."""
    FAILURE = "failure"
    """A healthy joint would move under this effort and command."""


@dataclass(frozen=True)
class JointStill(Reason, code="joint_still"):
    """The joint of a record stands still although its command moves."""

    cause: StandstillCause
    travel: float
    least_travel: float
    """Travel of the command, and smallest travel that shows a failure, in ``angle_unit``."""
    angle_unit: str
    effort: float
    friction: float
    """Measured effort and healthy friction, in ``effort_unit``."""
    effort_unit: str


@dataclass(frozen=True)
class OtherZero(Reason, code="other_zero"):
    """Shifting the position zero by ``shift`` [rad] improves the agreement of the record."""

    shift: float


@dataclass(frozen=True)
class EffortShifted(Reason, code="effort_shifted"):
    """The effort lags the healthy records by ``shift_s`` [s]; the lag is corrected."""

    shift_s: float


@dataclass(frozen=True)
class SpikesRemoved(Reason, code="spikes_removed"):
    """``spikes`` of ``samples`` effort samples were removed as spikes."""

    spikes: int
    samples: int


@dataclass(frozen=True)
class OtherUpdates(Reason, code="other_updates"):
    """The position is updated every ``samples`` samples, in healthy records every ``healthy``."""

    samples: float
    healthy: float


@dataclass(frozen=True)
class SamplesInterpolated(Reason, code="samples_interpolated"):
    """``interpolated`` of ``samples`` samples were lost and interpolated."""

    interpolated: int
    samples: int
