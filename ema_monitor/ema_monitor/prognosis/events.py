# SPDX-License-Identifier: Apache-2.0
"""Typed events of a unit: what happened, with names and figures as fields.

Programs use the kind and the fields of an event. `ema_monitor.prognosis.event_texts` has the
sentences for people.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar, Final, Self

from ema_core.event_kinds import EventKind
from ema_monitor.health import FaultHealth, Recurrence
from ema_monitor.identification.estimate import plain, read_number, reasons_of
from ema_monitor.joint.comparison import Comparison
from ema_monitor.reasons import Reason

OCCURRENCES: Final[dict[str, type["Occurrence"]]] = {}
"""Classes of occurrences by code."""


@dataclass(frozen=True)
class Occurrence:
    """Base class: what happened to a unit or to its monitoring. Each subclass has one sentence."""

    code: ClassVar[str]
    """Name of the subclass in records."""
    _kind: ClassVar[EventKind]

    def __init_subclass__(cls, code: str, kind: EventKind) -> None:
        super().__init_subclass__()
        cls.code, cls._kind = code, kind
        OCCURRENCES[code] = cls

    @property
    def kind(self) -> EventKind:
        """Kind of the event."""
        return self._kind

    @property
    def count(self) -> int:
        """Number of tests that the occurrence concerns; 0 if it has no such number."""
        return 0

    def as_record(self) -> dict[str, Any]:
        """Return code and fields as plain values for JSON."""
        return {"code": self.code} | plain(self._values())

    def _values(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def of_record(cls, record: Mapping[str, Any]) -> "Occurrence":
        """Return the occurrence for the output of ``as_record``, also after a JSON round trip.

        Raises
        ------
        ValueError, KeyError, TypeError
            If ``record`` does not describe an occurrence.
        """
        values = dict(record)
        code = values.pop("code")
        if code not in OCCURRENCES:
            raise ValueError(f"code = {code!r}: expected one of {', '.join(OCCURRENCES)}")
        return OCCURRENCES[code]._read(values)

    @classmethod
    def _read(cls, values: dict[str, Any]) -> Self:
        return cls(**_with_numbers(cls, values))


@dataclass(frozen=True, slots=True)
class UnitEvent:
    """An event in the life or the monitoring of a unit."""

    stamp_ns: int
    """Stamp of the test that showed the event [ns]."""
    flight_hours: float
    """Service hours at the event [h]; NaN when unknown."""
    occurrence: Occurrence
    """What happened."""

    @property
    def kind(self) -> EventKind:
        """Kind as in ``ema_interfaces/msg/UnitEvent``."""
        return self.occurrence.kind


def _with_numbers(owner: type[Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a dataclass's fields from JSON: None as NaN, lists as tuples."""
    numbers = {item.name for item in fields(owner) if item.type is float}
    return {
        name: read_number(value) if name in numbers else _as_tuple(value)
        for name, value in values.items()
    }


def _as_tuple(value: Any) -> Any:
    return tuple(map(_as_tuple, value)) if isinstance(value, list) else value


# Values that growth does not explain.


@dataclass(frozen=True)
class ValuesDisagree(Occurrence, code="values_disagree", kind=EventKind.OUTLIER):
    """Two of the first tests disagree; the next test decides which value is used."""

    component: str
    """Component of the fault vector."""
    before: float
    before_hours: float
    """Value in the earlier test [-], and its service hours [h]."""
    after: float
    hours: float
    """Value in this test [-], and its service hours [h]."""


@dataclass(frozen=True)
class ValueUnexpected(Occurrence, code="value_unexpected", kind=EventKind.OUTLIER):
    """Growth does not explain a value. The test is held back until the next test.

    If the next test agrees, `ValueChanged` follows; otherwise the held test is discarded.
    """

    component: str
    """Component of the fault vector."""
    value: float
    hours: float
    """Value in this test [-], and its service hours [h]."""
    expected: float
    sigma: float
    """Predicted value and its standard deviation [-]."""


@dataclass(frozen=True)
class ValueChanged(Occurrence, code="value_changed", kind=EventKind.STEP):
    """A fault changed abruptly, and a later test confirmed the change."""

    component: str
    """Component of the fault vector."""
    before: float
    after: float
    """Predicted and measured value [-]."""
    hours: float
    """Service hour of the first test that showed the new value [h]."""
    is_smaller: bool
    """Whether the fault became smaller, as by a repair."""
    is_new_baseline: bool = False
    """Whether the baseline changed as well, so that values relate to a new healthy state."""

    @property
    def kind(self) -> EventKind:
        """Kind of the event; a change due to a new baseline is neither repair nor step."""
        if self.is_new_baseline:
            return EventKind.CALIBRATION
        return EventKind.REPAIR if self.is_smaller else EventKind.STEP


# Levels and findings of tests.


@dataclass(frozen=True)
class AlarmRaised(Occurrence, code="alarm_raised", kind=EventKind.FAULT):
    """A fault or requirement reached a higher level, WARN or ERROR."""

    item: FaultHealth

    def _values(self) -> dict[str, Any]:
        recurrence = self.item.recurrence
        figures = None if recurrence is None else recurrence._asdict()
        return {"item": asdict(self.item) | {"recurrence": figures}}

    @classmethod
    def _read(cls, values: dict[str, Any]) -> Self:
        item = _with_numbers(FaultHealth, values["item"])
        if item["recurrence"] is not None:
            item["recurrence"] = _recurrence_of(item["recurrence"])
        return cls(FaultHealth(**item))


@dataclass(frozen=True)
class FaultRecurred(Occurrence, code="fault_recurred", kind=EventKind.FAULT):
    """A fault exceeded its limit in some of the latest tests: intermittently, or once."""

    name: str
    """Component of the fault vector."""
    recurrence: Recurrence

    def _values(self) -> dict[str, Any]:
        return {"name": self.name, "recurrence": self.recurrence._asdict()}

    @classmethod
    def _read(cls, values: dict[str, Any]) -> Self:
        return cls(values["name"], _recurrence_of(values["recurrence"]))


def _recurrence_of(values: dict[str, Any]) -> Recurrence:
    worst = read_number(values["worst"])
    return Recurrence(values["times"], values["tests"], worst, values["tests_left"])


@dataclass(frozen=True)
class UnitFailed(Occurrence, code="unit_failed", kind=EventKind.FAULT):
    """A test shows a failure of drive, sensor or shaft."""

    reasons: tuple[Reason, ...]

    def _values(self) -> dict[str, Any]:
        return {"reasons": [reason.as_record() for reason in self.reasons]}

    @classmethod
    def _read(cls, values: dict[str, Any]) -> Self:
        return cls(reasons_of(values))


@dataclass(frozen=True)
class UnitDeparted(Occurrence, code="unit_departed", kind=EventKind.DEPARTURE):
    """A test differs from the healthy tests of the unit, and no fault explains the difference."""

    reasons: tuple[Reason, ...]
    comparison: Comparison | None = None
    """Comparison with healthy records, if the verdict follows from it; None otherwise."""

    def _values(self) -> dict[str, Any]:
        return {
            "reasons": [reason.as_record() for reason in self.reasons],
            "comparison": None if self.comparison is None else self.comparison.as_mapping(),
        }

    @classmethod
    def _read(cls, values: dict[str, Any]) -> Self:
        compared = values["comparison"]
        comparison = None if compared is None else Comparison.of_mapping(compared)
        return cls(reasons_of(values), comparison)


# Order and number of tests.


@dataclass(frozen=True)
class EstimatesMissing(Occurrence, code="estimates_missing", kind=EventKind.GAP):
    """Tests before this test have no valid estimate."""

    tests: int

    @property
    def count(self) -> int:
        """Number of tests without a valid estimate."""
        return self.tests


@dataclass(frozen=True)
class DuplicateIgnored(Occurrence, code="duplicate_ignored", kind=EventKind.OTHER):
    """A received test is ignored, because it is already in the history."""


@dataclass(frozen=True)
class LateTestUsed(Occurrence, code="late_test_used", kind=EventKind.OTHER):
    """A valid test arrived that is older than the latest test."""

    late_s: float
    """Time from the test to the latest test [s]."""


# Service hours.


@dataclass(frozen=True)
class CountIgnored(Occurrence, code="count_ignored", kind=EventKind.SERVICE_HOURS):
    """Counts of service hours are ignored, because ``hours_per_cycle`` is set."""

    hours: float
    """Counted service hours [h]."""
    hours_per_cycle: float
    """The parameter [h]."""


@dataclass(frozen=True)
class UncountedDropped(Occurrence, code="uncounted_dropped", kind=EventKind.SERVICE_HOURS):
    """Service hours are counted from now on; tests with hours from test cycles are left out."""

    tests: int

    @property
    def count(self) -> int:
        """Number of tests that are left out."""
        return self.tests


@dataclass(frozen=True)
class CountNotConfirmed(Occurrence, code="count_not_confirmed", kind=EventKind.SERVICE_HOURS):
    """The next count contradicts an implausible count; the hours are interpolated."""

    hours: float
    """The implausible count [h]."""
    cycle: int
    """Test cycle with this count."""
    next_hours: float
    """The next count [h]."""


@dataclass(frozen=True)
class CountConfirmed(Occurrence, code="count_confirmed", kind=EventKind.SERVICE_HOURS):
    """The next count confirms an implausible count: the service hours were set."""

    before: float
    after: float
    """Service hours of the latest used test and of this test [h]."""
    dropped: int = 0
    """Number of tests that are left out, because their hours exceed ``held``."""
    held: float = 0.0
    """The count that was implausible [h]."""

    @property
    def count(self) -> int:
        """Number of tests that are left out."""
        return self.dropped


# The monitor, its history and its calibrations.


@dataclass(frozen=True)
class MonitorStarted(Occurrence, code="monitor_started", kind=EventKind.RESTART):
    """The monitor started and read a history."""

    tests: int
    """Number of valid tests in the history."""

    @property
    def count(self) -> int:
        """Number of these tests."""
        return self.tests


@dataclass(frozen=True)
class HistoryDamaged(Occurrence, code="history_damaged", kind=EventKind.HISTORY):
    """The file of the history cannot be used, or was repaired."""

    problem: str
    """Description of the problem, with the path of the file."""


@dataclass(frozen=True)
class CalibrationReplaced(Occurrence, code="calibration_replaced", kind=EventKind.CALIBRATION):
    """The latest test has a different calibration than the test before."""

    before: str
    after: str
    """Identities of the calibrations."""


@dataclass(frozen=True)
class BaselineChanged(Occurrence, code="baseline_changed", kind=EventKind.CALIBRATION):
    """A person changed the baseline."""

    person: str
    """Person or rule that changed it; empty if no person is known."""
    time_ns: int
    """Time of the change since 1970, UTC [ns]; 0 if unknown."""
    is_forced: bool
    """Whether the person accepted a unit that the monitor would have refused."""
    before: str
    after: str
    """Identities of the calibrations; ``after`` is empty if the unit learns again after a reset."""
    faults: tuple[tuple[str, float], ...]
    """Names and values of the faults that the unit showed with the earlier calibration."""


@dataclass(frozen=True)
class Note(Occurrence, code="note", kind=EventKind.NOTE):
    """A person wrote a note on a test."""

    person: str
    text: str
    time_ns: int
    """Time at which the note was written, since 1970, UTC [ns]; 0 if unknown."""
