"""A test in the history of a unit, and its record in the file."""

import json
import math
from dataclasses import asdict, dataclass
from typing import Any

from ema_monitor.identification.estimate import Estimate, estimate_of, estimate_record, plain_number
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.service_count import Count


@dataclass(frozen=True, eq=False)
class Entry:
    """One valid test.

    Attributes
    ----------
    estimate
        What was found in its window.
    hours
        Service hour of the test by ``hours_per_cycle`` [h]; NaN where it is counted or unknown.
    cycles
        Test cycles up to it, itself included.
    count
        The latest count of service hours before the test; None where there is none, or where
        ``hours_per_cycle`` holds.

    Raises
    ------
    ValueError
        When the estimate is not valid, or a figure of it is impossible.
    """

    estimate: Estimate
    hours: float
    cycles: int
    count: Count | None = None

    def __post_init__(self) -> None:
        Measurement.of(self.estimate, 0.0 if math.isnan(self.hours) else self.hours)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the window's end [ns]."""
        return self.estimate.end_ns


@dataclass(frozen=True)
class UnusedCycle:
    """A test cycle that counts as use but has no valid estimate.

    Attributes
    ----------
    stamp_ns
        Stamp of the window's end [ns].
    """

    stamp_ns: int


def as_text(test: Entry | UnusedCycle) -> str:
    """Return a test as JSON.

    Parameters
    ----------
    test
        The test.
    """
    if isinstance(test, UnusedCycle):
        return json.dumps({"end_ns": test.stamp_ns})
    record = {
        "end_ns": test.stamp_ns,
        "hours": plain_number(test.hours),
        "cycles": test.cycles,
        "count": asdict(test.count) if test.count else None,
        "estimate": estimate_record(test.estimate),
    }
    return json.dumps(record, ensure_ascii=False, allow_nan=False)


def entry_of(text: str) -> Entry | UnusedCycle:
    """Return the test that a text describes.

    Parameters
    ----------
    text
        As of ``as_text``.

    Raises
    ------
    ValueError, KeyError, TypeError
        When it describes none.
    """
    record: dict[str, Any] = json.loads(text)
    if "estimate" not in record:
        return UnusedCycle(record["end_ns"])
    hours, count = record["hours"], record["count"]
    return Entry(
        estimate_of(record["estimate"]),
        math.nan if hours is None else hours,
        record["cycles"],
        Count(**count) if count else None,
    )
