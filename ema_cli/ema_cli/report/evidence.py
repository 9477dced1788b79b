"""What the verdict of a report rests on, as rows of tables."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from ema_cli.report.words import Shown, life_in_words, moment, shown
from ema_cli.unit_diagnosis import UnitDiagnosis
from ema_core.causes import CauseEstimate
from ema_core.faults import FAULT_BY_NAME
from ema_core.levels import LEVEL_NAMES
from ema_monitor.health import FaultHealth
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.sentences import TREND_HOURS

_WIDENED: Final = 1.05


class Component(NamedTuple):
    """A fault in a test.

    Attributes
    ----------
    value, sigma
        Estimate and standard deviation [-]; NaN where there is none.
    significant
        Whether the test shows that it is not healthy.
    """

    value: float
    sigma: float
    significant: bool


@dataclass(frozen=True)
class OneTest:
    """A test.

    Attributes
    ----------
    time
        When it ended, in words.
    hours
        Service hours [h]; NaN when unknown.
    level
        Name of the level of health after it; empty without a valid estimate.
    remarks
        Why there is no estimate or what limits it, hidden causes and events.
    faults
        Each component of the estimate.
    """

    number: int
    bag: str
    time: str
    hours: float
    verdict: str
    level: str
    goodness: float
    goodness_limit: float
    unexplained: float
    remarks: list[str]
    faults: list[Component]


class Limited(NamedTuple):
    """A fault or required performance, and how far it is from its limit.

    Attributes
    ----------
    value, sigma, share, trend
        In the unit of the health message; the trend is that in 1000 h.
    meaning
        What a fault amounts to, in words.
    life
        Remaining life, or why it is unknown, in words.
    """

    shown: Shown
    level: str
    value: float
    sigma: float
    share: float
    trend: float
    meaning: str
    life: str


class FoundCause(NamedTuple):
    """A hidden cause: in how many tests it was found, and the latest of these."""

    words: str
    tests: int
    latest: str


def tests_of(told: UnitDiagnosis) -> list[OneTest]:
    """Return all tests, in order of time."""
    return [
        _test(number, step.estimate, step.outlook, told)
        for number, step in enumerate(told.course.steps)
    ]


def _test(number: int, one: Estimate, outlook: Outlook | None, told: UnitDiagnosis) -> OneTest:
    path = told.record.bags.get(one.end_ns)
    known = ~(one.insignificant | one.unobservable)
    # The reason names the hidden causes.
    remarks = [one.reason] if one.reason else []
    remarks += [f"measured: {cause}" for cause in one.measured]
    if outlook is not None:
        remarks += [f"event: {event}" for event in outlook.events]
    return OneTest(
        number,
        path.name if path else "",
        moment(one.end_ns),
        outlook.hours if outlook else math.nan,
        one.verdict,
        LEVEL_NAMES[outlook.health.level] if outlook else "",
        one.goodness_of_fit,
        one.goodness_limit,
        one.unexplained_share,
        remarks,
        [Component(*row) for row in zip(one.faults, one.sigma, known.tolist(), strict=True)],
    )


def limited(outlook: Outlook) -> tuple[list[Limited], list[Limited], str]:
    """Return faults, required performance, and why no life is known, if it is one reason for all.

    Parameters
    ----------
    outlook
        That after the last valid test.
    """
    groups = outlook.health.faults, outlook.health.requirements
    lives = [outlook.lives.get(item.name, outlook.rul) for group in groups for item in group]
    reasons = {life.reason for life in lives if not life.known}
    common = reasons.pop() if len(reasons) == 1 and not any(life.known for life in lives) else ""
    faults, requirements = ([_limited(item, outlook, common) for item in group] for group in groups)
    return faults, requirements, common


def _limited(item: FaultHealth, outlook: Outlook, common: str) -> Limited:
    life = outlook.lives.get(item.name, outlook.rul)
    fault = FAULT_BY_NAME.get(item.name)
    unknown = "unknown" if life.reason in ("", common) else life.reason
    return Limited(
        shown(item),
        LEVEL_NAMES[item.level],
        item.value,
        item.sigma,
        item.share,
        TREND_HOURS * outlook.trends.get(item.name, math.nan),
        fault.physical(item.value) if fault is not None else "",
        f"{life_in_words(life)} h{_widening(item.name, outlook)}" if life.known else unknown,
    )


def _widening(name: str, outlook: Outlook) -> str:
    """Return in words that an interval is wider for what came of earlier predictions."""
    checked = outlook.calibrations.get(name)
    if checked is None or not checked.widening > _WIDENED:
        return ""
    return f" (widened by {checked.widening:.2f}: earlier predictions were too sure)"


def hidden_causes(told: UnitDiagnosis) -> list[FoundCause]:
    """Return the hidden causes that are part of the explanation of valid tests."""
    found: dict[str, tuple[int, CauseEstimate, Estimate]] = {}
    for one in told.estimates:
        for cause in one.causes if one.valid else ():
            tests, *_ = found.get(cause.name, (0,))
            found[cause.name] = (tests + 1, cause, one)
    return [
        FoundCause(str(cause), tests, moment(one.end_ns)) for tests, cause, one in found.values()
    ]


def confusions(told: UnitDiagnosis) -> list[tuple[str, str, int]]:
    """Return the pairs that tests could not tell apart, and in how many of them."""
    counts: dict[tuple[str, str], int] = {}
    for one in told.estimates:
        for first, second in one.alternatives if one.valid else ():
            counts[first, second] = counts.get((first, second), 0) + 1
    return [(*pair, count) for pair, count in counts.items()]
