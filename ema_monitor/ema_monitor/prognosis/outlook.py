"""What is said of an actuator after a test: its health, and how long it will last."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from ema_core.levels import ERROR, STALE, WARN
from ema_monitor.health import Health, HealthLimits, assess
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.growth.prediction import RemainingLife, assumption_of


@dataclass(frozen=True)
class Outlook:
    """Health and remaining life of an actuator.

    Attributes
    ----------
    stamp_ns
        Stamp of the test on which it rests [ns].
    hours
        Service hours at that test [h]; NaN when unknown.
    cycles
        Test cycles up to it.
    hours_per_cycle
        Flight hours from a test cycle to the next [h]; NaN when unknown.
    health
        Levels, index and grade.
    trends
        Growth by fault and by requirement [its unit per flight hour]; what is not named is
        unknown.
    lives
        Remaining life until each fault, and each requirement, reaches its limit, by name; what is
        not named is as unknown as ``rul``.
    rul_faults, rul_requirements, rul
        Until the first fault does, the first requirement, and the earlier of both.
    dominant
        Fault or requirement that ends life first; the worst with a warning when none is known to
        end it; else empty.
    duty
        Growth of the faults in a future flight hour, relative to a past one [-].
    assumption
        What is assumed of future use, in words.
    events
        What the latest test revealed, in words.
    """

    stamp_ns: int
    hours: float
    cycles: int
    hours_per_cycle: float
    health: Health
    trends: Mapping[str, float]
    lives: Mapping[str, RemainingLife]
    rul_faults: RemainingLife
    rul_requirements: RemainingLife
    rul: RemainingLife
    dominant: str
    duty: float
    assumption: str
    events: tuple[str, ...]


def unknown_outlook(reason: str) -> Outlook:
    """Return what is said before any test.

    Parameters
    ----------
    reason
        Why nothing is known.
    """
    life = RemainingLife.unknown("", reason)
    return Outlook(
        stamp_ns=0,
        hours=math.nan,
        cycles=0,
        hours_per_cycle=math.nan,
        health=Health(STALE, math.nan, 0, 0.0, "", reason=reason),
        trends={},
        lives={},
        rul_faults=life,
        rul_requirements=life,
        rul=life,
        dominant="",
        duty=1.0,
        assumption=assumption_of(1.0),
        events=(),
    )


def outlook_of_one(estimate: Estimate, limits: HealthLimits, reason: str) -> Outlook:
    """Return what a valid estimate tells by itself.

    Parameters
    ----------
    estimate
        What was found in a window.
    limits
        Where life ends.
    reason
        Why nothing more is known.
    """
    health = assess(estimate, limits)
    return replace(
        unknown_outlook(reason),
        stamp_ns=estimate.end_ns,
        health=health,
        dominant=health.dominant_fault,
    )


def worst_with_warning(health: Health) -> str:
    """Return the fault or requirement that is worst, by level and then by the way to its limit.

    Parameters
    ----------
    health
        As to faults and requirements. Empty is returned when none of them gives a warning.
    """
    items = (*health.faults, *health.requirements)
    alarmed = [item for item in items if item.level in (WARN, ERROR)]
    worst = max(alarmed, key=lambda item: (item.level, item.share), default=None)
    return worst.name if worst else ""


def earlier(one: RemainingLife, other: RemainingLife, together: RemainingLife) -> RemainingLife:
    """Return the life that ends with the first of two.

    Parameters
    ----------
    one, other
        Lives of the same actuator.
    together
        Life that ends with the first of them, from samples that both share. It may rest on fewer
        samples: what is told is never longer than either by itself. The criterion is that of the
        lesser median.
    """
    known = [life for life in (one, other) if life.known]
    if not known:
        reasons = dict.fromkeys(filter(None, [one.reason, other.reason]))
        return RemainingLife.unknown("the first fault limit or requirement", "; ".join(reasons))
    first = min(known, key=lambda life: life.hours_50)
    every = [*known, together] if together.known else known
    return RemainingLife(
        True,
        min(life.hours_05 for life in every),
        min(life.hours_50 for life in every),
        min(life.hours_95 for life in every),
        first.criterion,
    )
