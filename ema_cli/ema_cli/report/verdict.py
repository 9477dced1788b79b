# SPDX-License-Identifier: Apache-2.0
"""Verdict of a report: state, wear, remaining life, actions, and the basis of the verdict."""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from ema_cli.bags.unit_course import Course
from ema_cli.show.prognosis_table import WIDENED, advice_text
from ema_core.causes import CAUSE_BY_NAME, SystemPart
from ema_core.dates import moment
from ema_core.description import ActuatorDescription
from ema_core.faults import FAULTS
from ema_core.labels import label_of
from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN
from ema_core.linear import physical
from ema_core.wording import beside_limit, counted
from ema_monitor.health import FaultHealth
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.joint.comparison import Comparison
from ema_monitor.joint.wording import finding, improvement_sentences
from ema_monitor.prognosis.event_texts import event_text
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.sentences import TREND_HOURS, cause_of_level, removal_text, shown_in
from ema_monitor.quantities import FRICTION
from ema_monitor.reason_texts import part_label

_STATES: Final = {OK: "Well", WARN: "Wearing", ERROR: "Failed", STALE: "Unknown"}


class Shown(NamedTuple):
    """Label, value and limit of a fault or requirement as displayed.

    Values are multiplied by ``scale``; ``unit`` starts with a space, or is empty.
    """

    label: str
    scale: float
    unit: str
    value_and_sigma: str
    limit: str


def shown(item: FaultHealth) -> Shown:
    """Return label, value and limit of a fault or requirement as displayed."""
    unit, scale = shown_in(RequirementLimits.unit(item.name))
    value, limit = beside_limit(scale * item.value, scale * item.limit)
    sigma = scale * item.sigma
    uncertainty = f" ± {sigma:.2g}" if math.isfinite(sigma) else ""
    side = "≥" if item.limit_is_lower else "≤"
    words = f"{value}{uncertainty}{unit}", f"{side} {limit}{unit}"
    return Shown(label_of(item.name), scale, unit, *words)


def life_text(life: RemainingLife) -> str:
    """Return the 5, 50 and 95 % quantiles of a known remaining life [h] as a string."""
    return " / ".join(
        "longer" if not math.isfinite(item) else f"{item:,.0f}" if item >= 9.95 else f"{item:.1f}"
        for item in (life.hours_05, life.hours_50, life.hours_95)
    )


def tests_of(course: Course) -> list[dict[str, Any]]:
    """Return one row per test, in chronological order."""
    rows = []
    for number, (step, outlook) in enumerate(course.steps):
        path = course.record.bags.get(step.end_ns)
        # The reason names the hidden causes.
        remarks = [step.reason, *(f"measured: {cause}" for cause in step.measured)]
        remarks += [f"event: {event_text(event)}" for event in (outlook.events if outlook else ())]
        rows.append(
            {
                "number": number,
                "bag": path.name if path else "",
                "time": moment(step.end_ns),
                "hours": outlook.flight_hours if outlook else math.nan,
                "verdict": step.verdict,
                "level": LEVEL_NAMES[outlook.health.level] if outlook else "",
                "goodness": step.goodness_of_fit,
                "goodness_limit": step.goodness_limit,
                "unexplained": step.unexplained_share,
                "remarks": [*filter(None, remarks)],
                "faults": list(zip(step.faults, step.sigma, step.found.tolist(), strict=True)),
            }
        )
    return rows


def limited(
    outlook: Outlook, description: ActuatorDescription
) -> tuple[list[dict[str, Any]], list[dict[str, Any]], str]:
    """Return rows of faults, rows of requirements, and the reason if all lives are unknown.

    The reason is "" if a life is known or the reasons differ.
    """
    groups = outlook.health.faults, outlook.health.requirements
    lives = [outlook.lives.get(item.name, outlook.rul) for group in groups for item in group]
    reasons = {life.reason for life in lives if not life.known}
    common = reasons.pop() if len(reasons) == 1 and not any(life.known for life in lives) else ""
    faults, requirements = (
        [_limited(item, outlook, common, description) for item in group] for group in groups
    )
    return faults, requirements, common


def is_unjudged(course: Course) -> bool:
    """Return whether the newest record does not determine the unit's level."""
    if not course.estimates or course.estimates[-1].comparison is None:
        return False
    return course.now.health.level == STALE


def latest_comparison(course: Course) -> tuple[Comparison, str] | None:
    """Return the comparison of the newest compared record, and the end of the record as text."""
    for estimate in reversed(course.estimates):
        if estimate.comparison is not None:
            return estimate.comparison, moment(estimate.end_ns)
    return None


def _limited(
    item: FaultHealth, outlook: Outlook, common: str, description: ActuatorDescription
) -> dict[str, Any]:
    life = outlook.lives.get(item.name, outlook.rul)
    words = "unknown" if life.reason in ("", common) else life.reason
    if life.known:
        words = f"{life_text(life)} h"
        past = outlook.track_records.get(item.name)
        if past is not None and past.widening > WIDENED:
            words += (
                f" (widened by {past.widening:.2f}, because earlier predictions were overconfident)"
            )
    return {
        "shown": shown(item),
        "level": LEVEL_NAMES[item.level],
        "value": item.value,
        "sigma": item.sigma,
        "share": item.share,
        "trend": TREND_HOURS * outlook.trends.get(item.name, math.nan),
        "meaning": physical(item.name, item.value, description),
        "life": words,
    }


def hidden_causes(course: Course) -> list[tuple[str, str, int]]:
    """Return the last value of each hidden cause in valid tests, its time, and number of tests."""
    tests, latest = Counter[str](), dict[str, tuple[str, str]]()
    for estimate in course.estimates:
        for cause in estimate.causes if estimate.valid else ():
            tests[cause.name] += 1
            latest[cause.name] = str(cause), moment(estimate.end_ns)
    return [(*words, tests[name]) for name, words in latest.items()]


def confusions(course: Course) -> list[tuple[str, str, int]]:
    """Return pairs of explanations that tests could not distinguish, with the number of tests."""
    counts = Counter(
        pair for estimate in course.estimates if estimate.valid for pair in estimate.alternatives
    )
    return [
        (part_label(part), part_label(stand_in), count)
        for (part, stand_in), count in counts.items()
    ]


@dataclass(frozen=True)
class UnitVerdict:
    """Verdict on a unit in a few lines, with actions."""

    level: int
    """Level of health."""
    lines: tuple[str, ...]
    """Lines on state, wear, remaining life and basis."""
    actions: list[str]
    """Recommended actions, the most important first."""

    @property
    def level_name(self) -> str:
        """Name of the level."""
        return LEVEL_NAMES[self.level]


def verdict_of(course: Course) -> UnitVerdict:
    """Return the verdict on a unit after its newest test."""
    last = course.now
    if not course.outlooks:
        tests = counted(len(course.estimates), "test")
        why = f"{cause_of_level(last)}; " if last.finding else ""
        latest = latest_comparison(course)
        if latest is not None and not why:
            why = f"{finding(latest[0])}; "
        return UnitVerdict(
            last.health.level,
            (
                f"{_STATES[last.health.level]}: {why}none of {tests} has a valid estimate.",
                "The wear is unknown.",
                "The remaining life is unknown.",
            ),
            _after_the_last_test(course),
        )
    valid = [estimate for estimate in course.estimates if estimate.valid][-1]
    lines = (
        _state(course, last),
        _wearing(course, last, valid),
        _lasting(last),
        _basis(course, last),
    )
    words = [advice_text(course), removal_text(last)]
    actions = [*map(_sentence, filter(None, words)), *_after_the_last_test(course)]
    return UnitVerdict(last.health.level, lines, actions)


def _state(course: Course, last: Outlook) -> str:
    level = last.health.level
    state = "Changed" if last.departure and level == WARN else _STATES[level]
    latest = latest_comparison(course)
    well = "no fault or requirement causes a warning"
    if latest is not None:
        well = finding(latest[0])
    return f"{state}: {cause_of_level(last) or well}."


def _basis(course: Course, last: Outlook) -> str:
    health, tests = last.health, counted(len(course.outlooks), "valid test")
    is_finite = math.isfinite(health.health_index) and health.level != STALE
    index = f"{health.health_index:.2f}" if is_finite else "unknown"
    return (
        f"{tests} of {len(course.estimates)}; health index {index}, severity {health.severity} "
        f"of 4, confidence {health.confidence:.2f}."
    )


def _wearing(course: Course, last: Outlook, valid: Estimate) -> str:
    items = {item.name: item for item in (*last.health.faults, *last.health.requirements)}
    faults = {
        fault.name
        for fault, is_significant in zip(FAULTS, valid.found, strict=True)
        if is_significant
    }
    worn = [item for item in last.health.faults if item.name in faults]
    worst = max(worn, key=lambda item: item.share, default=None)
    named = [items[last.dominant_fault]] if last.dominant_fault in items else []
    if worst is not None and worst not in named:
        named.append(worst)
    if not named and valid.comparison is not None and not valid.comparison[FRICTION].is_judged:
        why = valid.comparison[FRICTION].reason or "the record does not determine it"
        return f"Whether friction has grown is unknown: {why}."
    if not named:
        return "No fault differs from healthy by more than its uncertainty."
    description = course.record.description
    parts = [_item_text(item, last, description) for item in named]
    return f"{_sentence('; behind it '.join(parts))}"


def _item_text(item: FaultHealth, last: Outlook, description: ActuatorDescription) -> str:
    what = shown(item)
    words = f"{what.label} {what.value_and_sigma} against its limit {what.limit}"
    notes = list(filter(None, [physical(item.name, item.value, description)]))
    if item.share < 1.0:
        notes.append(f"{100.0 * item.share:.0f} % of the way")
    trend = what.scale * TREND_HOURS * last.trends.get(item.name, math.nan)
    if math.isfinite(trend):
        notes.append(f"{trend:+.3g}{what.unit} in {TREND_HOURS:g} h")
    return f"{words} ({', '.join(notes)})" if notes else words


def _lasting(last: Outlook) -> str:
    life = last.rul
    if last.failure:
        return "Its life has ended until it is repaired: drive or shaft has failed."
    if last.health.level == ERROR:
        return "Its life has ended: a limit is exceeded or a required performance has failed."
    if not life.known:
        return f"The remaining life is unknown: {life.reason or 'no growth is certain'}."
    before = last.flight_hours + last.removal.hours
    return (
        f"Remaining useful life {life_text(life)} service hours (5 / 50 / 95 %), until "
        f"{life.criterion}; remove before {before:,.0f} service hours."
    )


def _after_the_last_test(course: Course) -> list[str]:
    """Return actions that follow from the last test, such as repeating it or checking a sensor."""
    last = course.estimates[-1] if course.estimates else None
    if last is None:
        return ["Repeat the test: no fault reached wanted_sigma."]
    if last.verdict == Verdict.FAILED:
        return []
    if last.comparison is not None:
        return _after_the_last_record(last, last.comparison)
    actions = []
    if last.verdict == Verdict.DEPARTED:
        actions.append(f"Inspect the unit: the last test {last.reason}.")
    elif not last.valid:
        return [f"Repeat the test of {moment(last.end_ns)}: it was refused, {last.reason}."]
    for cause in last.causes:
        about = CAUSE_BY_NAME[cause.name]
        part = "sensor" if about.place is SystemPart.SENSOR else "installation"
        actions.append(
            f"Check the {part}: {cause} explains part of the last test and is not a fault."
        )
    for part, stand_in in last.alternatives:
        pair = f"{part_label(part)} from {part_label(stand_in)}"
        actions.append(f"The last test cannot separate {pair}: check both.")
    if last.verdict == Verdict.DEGRADED and not last.alternatives:
        actions.append(f"The last test is usable with wider uncertainty: {last.reason}.")
    return actions


def _after_the_last_record(last: Estimate, comparison: Comparison) -> list[str]:
    """Return actions that follow from the last record, and how to detect smaller changes."""
    actions = []
    if not last.valid:
        actions.append(f"Repeat the record of {moment(last.end_ns)}: {finding(comparison)}.")
    elif last.departure:
        actions.append(f"Inspect the unit: {last.departure}.")
    return actions + improvement_sentences(comparison)


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}."
