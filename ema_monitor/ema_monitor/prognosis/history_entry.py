"""A test in the history of a unit, and its record in a file."""

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any, Final

from ema_core.quantity import is_finite_number
from ema_monitor.identification.estimate import Estimate, estimate_of, estimate_record, plain_number
from ema_monitor.prognosis.duty.flown import FlownDuty
from ema_monitor.prognosis.growth.measurement import Measurement

_MOST_HOURS: Final = 1e7
_MOST_CYCLES: Final = 10**12
# Tests without a new count go on from the latest.
_MOST_KEPT_CYCLES: Final = 10 * _MOST_CYCLES
_MOST: Final = 2**63


@dataclass(frozen=True, slots=True)
class Count:
    """Service life of a unit as it was counted.

    Attributes
    ----------
    stamp_ns
        When the counts were read [ns].
    hours
        Hours in service since new [h], at most 1e7.
    cycles
        Test cycles since new, at most 1e12; 0 when they are not counted.

    Raises
    ------
    ValueError
        When a figure is impossible; the message names it.
    """

    stamp_ns: int
    hours: float
    cycles: int

    def __post_init__(self) -> None:
        if not is_finite_number(self.hours) or not 0.0 <= self.hours <= _MOST_HOURS:
            raise ValueError(
                f"flight_hours = {self.hours:g} h: expected a number in [0, {_MOST_HOURS:g}]"
            )
        if not 0 <= self.cycles <= _MOST_CYCLES:
            raise ValueError(
                f"cycles = {self.cycles}: expected a whole number in [0, {_MOST_CYCLES:g}]"
            )


@dataclass(frozen=True, slots=True)
class Entry:
    """One valid test.

    Attributes
    ----------
    estimate
        Estimate of its window.
    hours
        Service hour of the test by ``hours_per_cycle`` [h]; NaN where it is counted or unknown.
    cycles
        Test cycles up to it, itself included.
    count
        The latest count of service hours before the test; None where there is none, or where
        ``hours_per_cycle`` holds.
    flown
        Duty since the valid test before; None where no telemetry tells it.

    Raises
    ------
    ValueError
        When the estimate is not valid, or a figure of it is impossible.
    """

    estimate: Estimate
    hours: float
    cycles: int
    count: Count | None = None
    flown: FlownDuty | None = None

    def __post_init__(self) -> None:
        Measurement.of(self.estimate, 0.0 if math.isnan(self.hours) else self.hours)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the window's end [ns]."""
        return self.estimate.end_ns


@dataclass(frozen=True, slots=True)
class UnusedCycle:
    """A test cycle that counts as use but has no valid estimate.

    Attributes
    ----------
    stamp_ns
        Stamp of the window's end [ns].
    verdict, reason
        Of its estimate: why there is none.
    flown
        Duty since the test cycle before; None where no telemetry tells it.
    """

    stamp_ns: int
    verdict: str
    reason: str
    flown: FlownDuty | None = None


@contextmanager
def as_value_error() -> Iterator[None]:
    """Raise ``ValueError`` for whatever else a record that is none makes its reader raise."""
    try:
        yield
    except (ArithmeticError, AttributeError, IndexError, RecursionError) as error:
        raise ValueError(f"it is no record: {error!r}") from error


def whole(record: Mapping[str, Any], name: str) -> int:
    """Return a number of a record that is whole and has 64 bits; raise ``ValueError`` else."""
    value = record[name]
    if isinstance(value, bool) or not isinstance(value, int) or not -_MOST <= value < _MOST:
        raise ValueError(f"{name} = {str(value)[:40]}: expected a whole number of 64 bits")
    return value


def as_text(test: Entry | UnusedCycle) -> str:
    """Return a test as JSON."""
    record: dict[str, Any] = {"end_ns": test.stamp_ns}
    if isinstance(test, Entry):
        record |= {
            "hours": plain_number(test.hours),
            "cycles": test.cycles,
            "count": asdict(test.count) if test.count else None,
            "estimate": estimate_record(test.estimate),
        }
    else:
        record |= {"verdict": test.verdict, "reason": test.reason}
    if test.flown is not None:
        record["duty"] = test.flown.as_record()
    return json.dumps(record, ensure_ascii=False, allow_nan=False)


def count_of(record: Mapping[str, Any]) -> Count:
    """Return the count that its values are a record of; raise ``ValueError`` where one is not."""
    return Count(whole(record, "stamp_ns"), record["hours"], whole(record, "cycles"))


def cycles_of(record: Mapping[str, Any]) -> int:
    """Return the cycles of a record; raise ``ValueError`` where they are impossible."""
    cycles = whole(record, "cycles")
    if not 0 <= cycles <= _MOST_KEPT_CYCLES:
        raise ValueError(f"cycles = {cycles}: expected one in [0, {_MOST_KEPT_CYCLES:g}]")
    return cycles


@as_value_error()
def entry_of(text: str) -> Entry | UnusedCycle:
    """Return the test that a text of ``as_text`` describes.

    Raises
    ------
    ValueError, KeyError, TypeError
        When it describes none.
    """
    record: dict[str, Any] = json.loads(text)
    flown = FlownDuty.of_record(record["duty"]) if "duty" in record else None
    if "estimate" not in record:
        stamp_ns = whole(record, "end_ns")
        return UnusedCycle(stamp_ns, str(record["verdict"]), str(record["reason"]), flown)
    hours, count = record["hours"], record["count"]
    whole(record["estimate"], "end_ns")
    return Entry(
        estimate_of(record["estimate"]),
        math.nan if hours is None else hours,
        cycles_of(record),
        count_of(count) if count else None,
        flown,
    )
