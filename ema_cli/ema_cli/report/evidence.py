"""What the verdict of a report rests on, as rows of tables, and its figures in words."""

import math
from collections import Counter
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple

from ema_cli.bags.unit_course import Course
from ema_core.faults import FAULT_BY_NAME
from ema_core.levels import LEVEL_NAMES
from ema_monitor.health import FaultHealth
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.requirements.requirements import REQUIREMENTS, RequirementLimits
from ema_monitor.prognosis.sentences import TREND_HOURS, label_of, shown_in

_FIRST_DATE_NS: Final = 10 * 365 * 86_400_000_000_000
_WIDENED: Final = 1.05


class Shown(NamedTuple):
    """A fault or required performance as it is shown, ``unit`` with a blank before it."""

    label: str
    scale: float
    unit: str
    value_and_sigma: str
    limit: str


def shown(item: FaultHealth) -> Shown:
    """Return a fault or requirement as it is shown."""
    unit, scale = shown_in(RequirementLimits.unit(item.name) if item.name in REQUIREMENTS else "1")
    unit = f" {unit}" if unit else ""
    value, sigma, limit = (scale * one for one in (item.value, item.sigma, item.limit))
    uncertainty = f" ± {sigma:.2g}" if math.isfinite(sigma) else ""
    side = "≥" if item.limit_is_lower else "≤"
    words = f"{value:.3g}{uncertainty}{unit}", f"{side} {limit:.3g}{unit}"
    return Shown(label_of(item.name), scale, unit, *words)


def life_in_words(life: RemainingLife) -> str:
    """Return the quantiles of a life that is known [h]."""
    return " / ".join(
        "longer" if not math.isfinite(one) else f"{one:,.0f}" if one >= 9.95 else f"{one:.1f}"
        for one in (life.hours_05, life.hours_50, life.hours_95)
    )


def moment(stamp_ns: int) -> str:
    """Return a stamp as date and time, or in seconds where it counts from something else."""
    if stamp_ns < _FIRST_DATE_NS:
        return f"{stamp_ns * 1e-9:,.2f} s"
    return f"{datetime.fromtimestamp(stamp_ns * 1e-9, UTC):%Y-%m-%d %H:%M:%S} UTC"


def tests_of(course: Course) -> list[dict[str, Any]]:
    """Return all tests, in order of time."""
    rows = []
    for number, (one, outlook) in enumerate(course.steps):
        path = course.record.bags.get(one.end_ns)
        # The reason names the hidden causes.
        remarks = [one.reason, *(f"measured: {cause}" for cause in one.measured)]
        remarks += [f"event: {event}" for event in (outlook.events if outlook else ())]
        rows.append(
            {
                "number": number,
                "bag": path.name if path else "",
                "time": moment(one.end_ns),
                "hours": outlook.hours if outlook else math.nan,
                "verdict": one.verdict,
                "level": LEVEL_NAMES[outlook.health.level] if outlook else "",
                "goodness": one.goodness_of_fit,
                "goodness_limit": one.goodness_limit,
                "unexplained": one.unexplained_share,
                "remarks": [*filter(None, remarks)],
                "faults": list(zip(one.faults, one.sigma, one.found.tolist(), strict=True)),
            }
        )
    return rows


def limited(outlook: Outlook) -> tuple[list[dict[str, Any]], list[dict[str, Any]], str]:
    """Return faults, required performance, and why no life is known if that is the same for all."""
    groups = outlook.health.faults, outlook.health.requirements
    lives = [outlook.lives.get(item.name, outlook.rul) for group in groups for item in group]
    reasons = {life.reason for life in lives if not life.known}
    common = reasons.pop() if len(reasons) == 1 and not any(life.known for life in lives) else ""
    faults, requirements = ([_limited(item, outlook, common) for item in group] for group in groups)
    return faults, requirements, common


def _limited(item: FaultHealth, outlook: Outlook, common: str) -> dict[str, Any]:
    life = outlook.lives.get(item.name, outlook.rul)
    fault = FAULT_BY_NAME.get(item.name)
    words = "unknown" if life.reason in ("", common) else life.reason
    if life.known:
        words = f"{life_in_words(life)} h"
        checked = outlook.calibrations.get(item.name)
        if checked is not None and checked.widening > _WIDENED:
            words += f" (widened by {checked.widening:.2f}: earlier predictions were too sure)"
    return {
        "shown": shown(item),
        "level": LEVEL_NAMES[item.level],
        "value": item.value,
        "sigma": item.sigma,
        "share": item.share,
        "trend": TREND_HOURS * outlook.trends.get(item.name, math.nan),
        "meaning": fault.physical(item.value) if fault is not None else "",
        "life": words,
    }


def hidden_causes(course: Course) -> list[tuple[str, str, int]]:
    """Return the hidden causes of valid tests: the latest of each, when, and in how many tests."""
    tests, latest = Counter[str](), dict[str, tuple[str, str]]()
    for one in course.estimates:
        for cause in one.causes if one.valid else ():
            tests[cause.name] += 1
            latest[cause.name] = str(cause), moment(one.end_ns)
    return [(*words, tests[name]) for name, words in latest.items()]


def confusions(course: Course) -> list[tuple[str, str, int]]:
    """Return the pairs that tests could not tell apart, and in how many of them."""
    counts = Counter(pair for one in course.estimates if one.valid for pair in one.alternatives)
    return [(*pair, count) for pair, count in counts.items()]
