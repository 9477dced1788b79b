"""What a unit went through: its lives, the months in which it was tested, its calibration."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import pyarrow as pa

from ema_archive.partitions import month_of
from ema_core.levels import ERROR

LIVES: Final = pa.schema(
    [
        ("life", pa.int32()),
        ("begin_hours", pa.float64()),
        ("from_age", pa.float64()),
        ("to_age", pa.float64()),
        ("has_failed", pa.bool_()),
    ]
)
"""A row for each life of a unit, as in the view of runs to failure: a repair begins another one.

Service hours at which it began; its age, in service hours, when it was first tested and when it
failed, or was last tested; and which of both. It failed at its first test in ERROR.
"""

MONTHS: Final = pa.schema([("month", pa.string()), ("windows", pa.int32()), ("valid", pa.int32())])
"""A row for each month with tests of a unit: windows, and those with a valid estimate."""


@dataclass(frozen=True)
class ServiceRecord:
    """What a unit went through.

    Attributes
    ----------
    lives, months
        Rows of these tables.
    calibrated_ns
        When the file of its calibration was changed [ns]; None when that is unknown.
    """

    lives: list[dict[str, Any]] = field(default_factory=list)
    months: list[dict[str, Any]] = field(default_factory=list)
    calibrated_ns: int | None = None


def lives_of(health: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the lives of a unit.

    Parameters
    ----------
    health
        Its rows of health in order of time; those at unknown service hours tell no age.
    """
    lives: list[dict[str, Any]] = []
    repairs = 0
    for row in health:
        repairs += any(event["kind"] == "repair" for event in row["events"])
        hours = row["hours"]
        if not math.isfinite(hours):
            continue
        if not lives or lives[-1]["life"] != repairs:
            # The first one began with the unit; what it went through before its first test is
            # not known.
            begin = hours if repairs else 0.0
            age = hours - begin
            lives.append(
                {
                    "life": repairs,
                    "begin_hours": begin,
                    "from_age": age,
                    "to_age": age,
                    "has_failed": False,
                }
            )
        life = lives[-1]
        if not life["has_failed"]:
            life["to_age"] = hours - life["begin_hours"]
            life["has_failed"] = row["level"] == ERROR
    return lives


def months_of(estimates: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the months in which a unit was tested, of its rows of estimates."""
    windows, valid = Counter[str](), Counter[str]()
    for row in estimates:
        month = month_of(row["end_ns"])
        windows[month] += 1
        valid[month] += row["valid"]
    return [
        {"month": month, "windows": windows[month], "valid": valid[month]}
        for month in sorted(windows)
    ]
