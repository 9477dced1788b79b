# SPDX-License-Identifier: Apache-2.0
"""Table of joints: level and its start, change of friction, and further changes."""

from collections.abc import Sequence
from typing import Any, Final

from ema_cli.bags.joint_course import JointCourse
from ema_cli.show.terminal import level_text
from ema_core.dates import moment
from ema_core.levels import LEVEL_NAMES, STALE
from ema_core.wording import counted, text_table
from ema_monitor.identification.estimate import Estimate, plain
from ema_monitor.joint.comparison import Judgement, QuantityChange
from ema_monitor.joint.wording import smallest_text
from ema_monitor.quantities import FRICTION, QUANTITIES

HEADINGS: Final = ("joint", "level", "since", "records", "friction", "further changes")


def row_of(course: JointCourse) -> tuple[str, ...]:
    """Return the table cells of a joint, in the order of ``HEADINGS``."""
    level = "not judged" if course.level == STALE else level_text(course.level)
    records = f"{course.healthy} healthy, {len(course.estimates)} later"
    further = ", ".join(map(_changed, course.further_changes))
    return (
        course.description.actuator_id,
        level,
        _moment(course),
        records,
        friction_text(course.friction),
        further or "-",
    )


def joint_table(courses: Sequence[JointCourse]) -> list[str]:
    """Return the lines of the table, of reasons for levels that are not OK, and of advice.

    If joints are not judged, the last line has their number.
    """
    lines = text_table(HEADINGS, list(map(row_of, courses))).splitlines()
    reasons = [
        f"{course.description.actuator_id}: {course.reason}" for course in courses if course.reason
    ]
    unjudged = sum(course.level == STALE for course in courses)
    summary = f"{counted(len(courses), 'joint')}, {unjudged} of them not judged" if unjudged else ""
    by_advice: dict[str, list[str]] = {}
    for course in courses:
        by_advice.setdefault(course.advice, []).append(course.description.actuator_id)
    advice = [f"{', '.join(names)}: {text}" for text, names in by_advice.items() if text]
    return [*lines, *reasons, *advice, *filter(None, [summary])]


def warnings_of(courses: Sequence[JointCourse]) -> list[str]:
    """Return warnings about unread recordings and about records that may not be healthy."""
    unread = list(dict.fromkeys(text for course in courses for text in course.unread))
    doubts = [
        f"{course.description.actuator_id}: the healthy records may not be healthy: "
        f"{course.baseline_doubt}"
        for course in courses
        if course.baseline_doubt
    ]
    return [*unread, *doubts]


def mapping_of(course: JointCourse) -> dict[str, Any]:
    """Return a joint as plain values for JSON; unknown numbers are null."""
    comparison = course.valid[-1].comparison if course.valid else None
    return plain(
        {
            "joint": course.description.actuator_id,
            "level": LEVEL_NAMES[course.level],
            "level_since_ns": course.level_since_ns or None,
            "reason": course.reason,
            "healthy_records": course.healthy,
            "compared_records": len(course.valid),
            "refused_records": len(course.estimates) - len(course.valid),
            "comparison": comparison.as_mapping() if comparison else None,
            "records": [_record(estimate, course) for estimate in course.estimates],
            "remarks": course.remarks,
        }
    )


def _record(estimate: Estimate, course: JointCourse) -> dict[str, Any]:
    """Return times, level and change of friction of a compared or refused record for JSON."""
    friction = estimate.comparison[FRICTION] if estimate.comparison else None
    return {
        "start_ns": estimate.start_ns,
        "end_ns": estimate.end_ns,
        "level": LEVEL_NAMES[course.level_after(estimate.end_ns)],
        "verdict": estimate.verdict,
        "reason": estimate.reason,
        "changed": [item.name for item in estimate.comparison.changed]
        if estimate.comparison
        else [],
        "friction": None
        if friction is None
        else {"change": friction.change, "low": friction.low, "high": friction.high},
    }


def friction_text(friction: QuantityChange | None) -> str:
    """Return the change of friction with its interval as text, or why there is none."""
    if friction is None:
        return "-"
    if friction.judgement is Judgement.NOT_JUDGED:
        return f"not judged: {friction.reason}" if friction.reason else "not judged"
    text = f"{100.0 * friction.change:+.1f} % ({_interval(friction)})"
    if friction.judgement is Judgement.UNCHANGED:
        return f"{text}, unchanged: {smallest_text(friction)} would show"
    return text


def _changed(item: QuantityChange) -> str:
    label = QUANTITIES[item.name].label
    if item.unit != "-":
        return f"{label} {item.change:+.3g} {item.unit}"
    return f"{label} {100.0 * item.change:+.1f} %"


def _interval(item: QuantityChange) -> str:
    return f"{100.0 * item.low:+.1f} to {100.0 * item.high:+.1f} %"


def _moment(course: JointCourse) -> str:
    since_ns = course.level_since_ns
    return "-" if course.level == STALE or not since_ns else moment(since_ns)
