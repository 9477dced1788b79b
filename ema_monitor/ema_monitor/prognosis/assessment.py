"""What was found of a unit after each of its tests, as its history keeps it."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ema_core.levels import ERROR, WARN
from ema_core.quantity import is_finite_number
from ema_monitor.identification.estimate import plain_number, read_number
from ema_monitor.prognosis.history_entry import as_value_error
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.sentences import in_words
from ema_monitor.prognosis.unit_event import FAULT, Finding, UnitEvent


@dataclass(frozen=True, slots=True)
class Assessment:
    """Health and remaining life after a test.

    Attributes
    ----------
    stamp_ns, hours
        Stamp of the test [ns] and its service hours [h]; NaN when unknown.
    level, health_index, dominant_fault
        As of health.
    life
        5, 50 and 95 % quantiles of the remaining life [h]; None when it is unknown.
    alarms
        Levels of the faults and requirements in WARN or ERROR, by name.
    events
        What happened since the test before.
    """

    stamp_ns: int
    hours: float
    level: int
    health_index: float
    dominant_fault: str
    life: tuple[float, float, float] | None
    alarms: Mapping[str, int] = field(default_factory=dict)
    events: tuple[UnitEvent, ...] = ()


def assessment_of(
    outlook: Outlook,
    before: Assessment | None,
    findings: Iterable[Finding] = (),
    events: Iterable[UnitEvent] = (),
) -> Assessment:
    """Return an outlook as it is kept, with an event for each fault whose level got worse.

    Parameters
    ----------
    outlook
        After the test.
    before
        Assessment of the test before, or an earlier one of the same test; None when there is none.
    findings
        What the test revealed.
    events
        What happened at another time.
    """
    health, rul = outlook.health, outlook.rul
    items = [one for one in (*health.faults, *health.requirements) if one.level in (WARN, ERROR)]
    known = before.alarms if before else {}
    found = list(findings)
    found += [Finding(FAULT, in_words(one)) for one in items if one.level > known.get(one.name, 0)]
    stamp_ns, hours = outlook.stamp_ns, outlook.hours
    # One that is assessed again keeps what was shown first.
    kept = before.events if before and before.stamp_ns == stamp_ns else ()
    return Assessment(
        stamp_ns,
        hours,
        health.level,
        health.health_index,
        outlook.dominant,
        (rul.hours_05, rul.hours_50, rul.hours_95) if rul.known else None,
        {one.name: one.level for one in items},
        (*kept, *events, *(UnitEvent(stamp_ns, hours, *one) for one in found)),
    )


def assessment_text(one: Assessment) -> str:
    """Return an assessment as JSON."""
    record = {
        "end_ns": one.stamp_ns,
        "hours": plain_number(one.hours),
        "level": one.level,
        "health_index": plain_number(one.health_index),
        "dominant_fault": one.dominant_fault,
        "rul": [plain_number(hours) for hours in one.life] if one.life else None,
        "alarms": dict(one.alarms),
        "events": [
            {
                "stamp_ns": event.stamp_ns,
                "hours": plain_number(event.hours),
                "kind": event.kind,
                "text": event.text,
            }
            for event in one.events
        ],
    }
    return json.dumps(record, ensure_ascii=False, allow_nan=False)


@as_value_error()
def assessment_from(text: str) -> Assessment:
    """Return the assessment that a text of ``assessment_text`` describes.

    Raises
    ------
    ValueError, KeyError, TypeError
        When it describes none.
    """
    record: dict[str, Any] = json.loads(text)
    life = record["rul"]
    if not is_finite_number(record["end_ns"]):
        raise ValueError(f"end_ns = {record['end_ns']!r}: expected a stamp")
    return Assessment(
        int(record["end_ns"]),
        read_number(record["hours"]),
        int(record["level"]),
        read_number(record["health_index"]),
        str(record["dominant_fault"]),
        _quantiles(*life) if life else None,
        {str(name): int(level) for name, level in record["alarms"].items()},
        tuple(
            UnitEvent(
                int(event["stamp_ns"]),
                read_number(event["hours"]),
                str(event["kind"]),
                str(event["text"]),
            )
            for event in record["events"]
        ),
    )


def _quantiles(low: Any, median: Any, high: Any) -> tuple[float, float, float]:
    return read_number(low), read_number(median), read_number(high)
