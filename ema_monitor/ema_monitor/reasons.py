"""Why there is no estimate, or what qualifies it: values with figures.

A program decides by the kind of a reason, its ``code``. `ema_monitor.reason_texts` makes the
sentence where a person reads it.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar, Final, Self

from ema_core.column_errors import ColumnError, Kind, Mistake, Reference

KINDS: Final[dict[str, type["Reason"]]] = {}
"""Kinds of reasons by their code."""

_COUNTS: Final = ("stretches", "of_stretches")


@dataclass(frozen=True, kw_only=True)
class Reason:
    """Why there is no estimate, or what qualifies it; each kind is a subclass."""

    code: ClassVar[str]
    """Name of the kind."""
    stretches: int = 0
    of_stretches: int = 0
    """In how many of how many stretches of ordinary motion it holds; 0 where that is not
    counted."""

    def __init_subclass__(cls, code: str) -> None:
        super().__init_subclass__()
        cls.code = code
        KINDS[code] = cls

    def as_record(self) -> dict[str, Any]:
        """Return code and figures as plain values."""
        values = asdict(self)
        if not self.of_stretches:
            values = {name: value for name, value in values.items() if name not in _COUNTS}
        return {"code": self.code} | values

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> "Reason":
        """Return the reason of ``as_record``, or of the same read from JSON.

        Raises
        ------
        ValueError, KeyError, TypeError
            When it is not the record of a reason.
        """
        values = dict(record)
        code = values.pop("code")
        if code not in KINDS:
            raise ValueError(f"code = {code!r}: expected that of a reason: {', '.join(KINDS)}")
        return KINDS[code]._read(values)

    @classmethod
    def _read(cls, values: dict[str, Any]) -> Self:
        for item in fields(cls):
            if item.type is float:
                value = values[item.name]
                values[item.name] = math.nan if value is None else float(value)
        return cls(**{name: _as_tuple(value) for name, value in values.items()})


def _as_tuple(value: Any) -> Any:
    return tuple(map(_as_tuple, value)) if isinstance(value, list) else value


def codes(reasons: Iterable[Reason]) -> tuple[str, ...]:
    """Return the kinds of reasons, each once, in their order."""
    return tuple(dict.fromkeys(reason.code for reason in reasons))


# The window, its telemetry, and its place among the tests of a unit.


@dataclass(frozen=True)
class WindowUnusable(Reason, code="window_unusable"):
    """The window cannot be used, was cut off or was dropped."""

    detail: str


@dataclass(frozen=True)
class OrderUnknown(Reason, code="order_unknown"):
    """It is not known which test came first: the stamp is ``before_s`` before the newest one's.

    At 0, or below, it differs from a test with the same stamp.
    """

    before_s: float


@dataclass(frozen=True)
class StampsContradict(Reason, code="stamps_contradict"):
    """The stamps of recordings do not show which test came first: which, in words."""

    detail: str


@dataclass(frozen=True)
class NotMeasured(Reason, code="not_measured"):
    """The telemetry lacks a column."""

    column: str


@dataclass(frozen=True)
class FitnessNeedsCurrent(Reason, code="fitness_needs_current"):
    """The current is not measured, and ``fitness`` compares nothing else; ``usable`` does."""

    fitness: str
    usable: str


@dataclass(frozen=True)
class EffortMissing(Reason, code="effort_missing"):
    """A record of an unknown drive has neither current nor torque."""


@dataclass(frozen=True)
class SpeedGaps(Reason, code="speed_gaps"):
    """The speed of a record is not measured in some samples."""


@dataclass(frozen=True)
class NoTravel(Reason, code="no_travel"):
    """The command travels too little [rad] to excite the faults."""

    travel: float
    least: float


@dataclass(frozen=True)
class MotorStill(Reason, code="motor_still"):
    """The motor stands still although the command moves."""


@dataclass(frozen=True)
class NotDetermined(Reason, code="not_determined"):
    """A window, stretch or motion (``subject``) determines no fault better than its range."""

    subject: str


# The calibration.


@dataclass(frozen=True)
class NoCalibration(Reason, code="no_calibration"):
    """There is no calibration, or it cannot be used."""

    detail: str


@dataclass(frozen=True)
class DriveUnknown(Reason, code="drive_unknown"):
    """The drive is unknown, and the calibration is of a drive that is known."""


@dataclass(frozen=True)
class OtherUnit(Reason, code="other_unit"):
    """The calibration does not fit the actuator; ``forced``: an estimate was made all the same."""

    detail: str
    forced: bool = False


@dataclass(frozen=True)
class OtherSamples(Reason, code="other_samples"):
    """The samples of the window are not those calibrated."""

    detail: str


# Failures and mistakes that the telemetry shows.


@dataclass(frozen=True)
class Jam(Reason, code="jam"):
    """The shaft is blocked: the motor stands still while a current flows [A]."""

    current: float


@dataclass(frozen=True)
class OpenCircuit(Reason, code="open_circuit"):
    """A switch is dead or a phase open: of the current that is wanted, hardly any flows [A]."""

    wanted: float
    current: float


@dataclass(frozen=True)
class JamOrOpenCircuit(Reason, code="jam_or_open_circuit"):
    """The motor stands still although a current is wanted [A], and none is measured."""

    wanted: float


@dataclass(frozen=True)
class DeadSensor(Reason, code="dead_sensor"):
    """A column keeps one value although another one changes."""

    column: str
    value: float
    moving: str


MistakeRow = tuple[str, float, str, str]
"""Kind, factor, unit and stated unit of a usual mistake, as of ``ema_core.column_errors``."""


def mistake_row(mistake: Mistake) -> MistakeRow:
    """Return a mistake as plain values."""
    return mistake.kind.value, mistake.factor, mistake.unit, mistake.stated


def mistake_of(row: MistakeRow) -> Mistake:
    """Return the mistake of ``mistake_row``."""
    kind, factor, unit, stated = row
    return Mistake(Kind(kind), factor, unit, stated)


@dataclass(frozen=True)
class WrongScale(Reason, code="wrong_scale"):
    """Columns are off by a factor [-] from what ``reference`` asks for.

    ``mistakes`` are the usual ones that together give the factor; empty if none does.
    """

    columns: tuple[str, ...]
    factor: float
    reference: str
    mistakes: tuple[MistakeRow, ...]

    @classmethod
    def of(cls, error: ColumnError) -> Self:
        """Return the reason of a wrong column."""
        mistakes = tuple(map(mistake_row, error.mistakes))
        return cls(error.columns, error.factor, error.reference.value, mistakes)

    @property
    def error(self) -> ColumnError:
        """The wrong column."""
        mistakes = tuple(map(mistake_of, self.mistakes))
        return ColumnError(self.columns, self.factor, Reference(self.reference), mistakes)


# The search and its fit.


@dataclass(frozen=True)
class NoFiniteCost(Reason, code="no_finite_cost"):
    """No fault vector gave a finite cost."""


@dataclass(frozen=True)
class UncertaintyUnknown(Reason, code="uncertainty_unknown"):
    """The covariance cannot be computed."""

    detail: str


@dataclass(frozen=True)
class NotConverged(Reason, code="not_converged"):
    """The search was stopped before it converged."""


@dataclass(frozen=True)
class Contradicted(Reason, code="contradicted"):
    """A measured cause was not used, as the window, stretch or motion contradicts it."""

    subject: str
    name: str
    value: float
    sigma: float


@dataclass(frozen=True)
class CauseFound(Reason, code="cause_found"):
    """A hidden cause is part of the explanation; over stretches it is ``low`` to ``high``."""

    name: str
    value: float
    sigma: float
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True)
class SensorBeyondRange(Reason, code="sensor_beyond_range"):
    """The error of a sensor is at the end of the range of the search."""

    name: str
    value: float
    sigma: float


@dataclass(frozen=True)
class NotSeparated(Reason, code="not_separated"):
    """A part of the explanation, by names, and the parts that explain the motion as well."""

    subject: str
    part: tuple[str, ...]
    stand_ins: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class FitUnjudged(Reason, code="fit_unjudged"):
    """The healthy windows of the calibration do not give the scatter to judge the fit by."""

    calibration_windows: int


@dataclass(frozen=True)
class PoorFit(Reason, code="poor_fit"):
    """The residual is larger than expected, and little is unexplained."""

    goodness: float
    limit: float
    unexplained_share: float


@dataclass(frozen=True)
class Unexplained(Reason, code="unexplained"):
    """Neither faults nor hidden causes explain a window, stretch or motion."""

    subject: str
    goodness: float
    limit: float
    unexplained_share: float


# Stretches of ordinary motion, combined.


@dataclass(frozen=True)
class MotionEnded(Reason, code="motion_ended"):
    """The motion ended before every fault was known as well as wanted."""


@dataclass(frozen=True)
class MotionDisagrees(Reason, code="motion_disagrees"):
    """The motion that followed does not agree with the stretches."""


@dataclass(frozen=True)
class FaultsNotShown(Reason, code="faults_not_shown"):
    """The motion does not show some faults as well as wanted."""

    faults: tuple[str, ...]


@dataclass(frozen=True)
class StretchesInsufficient(Reason, code="stretches_insufficient"):
    """The stretches do not determine the faults as well as wanted."""


# Comparison with the windows and records of the healthy unit.


@dataclass(frozen=True)
class FiguresDeparted(Reason, code="figures_departed"):
    """Figures of the window depart, and no fault explains it."""

    figures: tuple[str, ...]
    """Names of the figures that depart, the most significant first."""
    probability: float
    """Probability that a healthy test differs as much."""
    detail: str
    """What departs, and the labelled state that is likely, in words."""


@dataclass(frozen=True)
class LabelledState(Reason, code="labelled_state"):
    """The labelled states that the window resembles, in words, or why none is named."""

    detail: str


@dataclass(frozen=True)
class WouldDepart(Reason, code="would_depart"):
    """A figure differs, and would depart on a day with healthy tests: by how much, in words."""

    figure: str
    detail: str


@dataclass(frozen=True)
class TooFewRows(Reason, code="too_few_rows"):
    """A record has too few rows of steady motion in one direction."""

    rows: int
    least: int


@dataclass(frozen=True)
class EffortConstant(Reason, code="effort_constant"):
    """The effort keeps one value although the joint moves."""

    effort: float


@dataclass(frozen=True)
class TooFewStrokes(Reason, code="too_few_strokes"):
    """A record has too few strokes in a direction, "forward" or "backward"."""

    strokes: int
    way: str
    least: int


@dataclass(frozen=True)
class SpeedOutside(Reason, code="speed_outside"):
    """The speed is outside the range that can be compared with the healthy records [-]."""

    ratio: float
    slowest: float
    fastest: float


@dataclass(frozen=True)
class SpeedScaled(Reason, code="speed_scaled"):
    """A column changes ``factor`` times as fast as in the healthy records, by a usual mistake."""

    column: str
    factor: float
    mistake: MistakeRow


@dataclass(frozen=True)
class EffortScaled(Reason, code="effort_scaled"):
    """The effort is a multiple of the healthy one [-]; without a ``mistake`` if it is unusual."""

    factor: float
    mistake: MistakeRow | tuple[()]


@dataclass(frozen=True)
class NegativeQuantity(Reason, code="negative_quantity"):
    """Friction or inertia of a record is below 0: ``ratio`` times the healthy one [-]."""

    name: str
    ratio: float


@dataclass(frozen=True)
class EffortReversed(Reason, code="effort_reversed"):
    """The effort has the other sign than in the healthy records, or follows another joint."""


@dataclass(frozen=True)
class JointStill(Reason, code="joint_still"):
    """The joint of a record stands still although its command moves."""

    cause: str
    """"no_effort": the effort is far below the friction; "short_command": the command travels less
    than in healthy records; or "failure"."""
    travel: float
    least_travel: float
    """Travel of the command, and the least by which a failure is judged, in ``angle_unit``."""
    angle_unit: str
    effort: float
    friction: float
    """Effort that acts, and healthy friction, in ``effort_unit``."""
    effort_unit: str


@dataclass(frozen=True)
class OtherZero(Reason, code="other_zero"):
    """The record agrees better if the position counts from another zero, ``shift`` away [rad]."""

    shift: float


@dataclass(frozen=True)
class EffortShifted(Reason, code="effort_shifted"):
    """The effort is later than in the healthy records [s], which is corrected."""

    shift_s: float


@dataclass(frozen=True)
class SpikesRemoved(Reason, code="spikes_removed"):
    """Samples of the effort, of all ``samples``, were left out as spikes."""

    spikes: int
    samples: int


@dataclass(frozen=True)
class SamplesInterpolated(Reason, code="samples_interpolated"):
    """Lost samples, of all ``samples``, were interpolated."""

    interpolated: int
    samples: int
