"""Health of an actuator from an estimate: levels, index and grade (docs/faults.md)."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from ema_core.faults import FAULTS, KINDS, LIMITS, kind_of, settings_by_kind
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.quantity import check_quantities, quantity
from ema_monitor.identification.estimate import Estimate

ONE_SIDED_95: Final = 1.645
"""Standard deviations from the mean to a one-sided 95 % bound [-]."""

_GRADES: Final = (0.5, 0.8, 1.0)


def _limit_of(kind: str) -> Any:
    fault = KINDS[kind][0]
    suffix = f", either way from {fault.healthy:g}" if fault.is_two_sided else ""
    if len(KINDS[kind]) > 1:
        suffix = ", each phase"
    words = kind.replace("_", " ")
    return quantity(LIMITS[kind], "-", 1e-3, 1.0 - fault.healthy, f"limit of {words}{suffix}")


@dataclass(frozen=True)
class HealthLimits(settings_by_kind("_LimitByKind", float, _limit_of)):
    """Where life ends, and how far from there a warning is due.

    There is a limit for each kind of fault, by its name: the largest distance of a component from
    its healthy value [-].

    Raises
    ------
    ValueError
        When a figure is outside its range; the message names it.
    """

    warn_share: float = quantity(
        0.2, "-", 1e-3, 1.0, "share of a limit that a fault's lower 95 % bound exceeds at a warning"
    )

    def __post_init__(self) -> None:
        check_quantities(self)

    def of(self, fault_name: str) -> float:
        """Return the limit of a component's distance from its healthy value [-].

        Parameters
        ----------
        fault_name
            Name of the component, other than the direction of eccentricity.
        """
        return getattr(self, kind_of(fault_name))


@dataclass(frozen=True)
class FaultHealth:
    """Health as to one fault.

    Attributes
    ----------
    name
        Component of the fault vector.
    level
        ``OK``, ``WARN`` or ``ERROR``; ``STALE`` when the window says nothing useful of it.
    value, sigma
        Estimate and its standard deviation [-]; sigma is NaN when unobservable.
    limit
        Value at which life ends [-].
    limit_is_lower
        Whether life ends below the limit rather than above.
    share
        Share of the way from healthy to the limit [-].
    """

    name: str
    level: int
    value: float
    sigma: float
    limit: float
    limit_is_lower: bool
    share: float


@dataclass(frozen=True)
class Health:
    """Health of an actuator.

    Attributes
    ----------
    level
        Worst of faults and requirements; ``STALE`` when there is nothing to go by.
    health_index
        Least of 1 - share over the faults, clipped to [0, 1] [-].
    severity
        Grade from 0 (as new) to 4 (at or above the limit).
    confidence
        How far this can be trusted, 0 to 1 [-].
    dominant_fault
        Fault nearest to its limit; empty when none gives a warning.
    faults
        Health as to each fault.
    reason
        What is unknown, and why; empty when nothing is.
    requirements
        Health as to each required performance; empty when none is watched.
    """

    level: int
    health_index: float
    severity: int
    confidence: float
    dominant_fault: str
    faults: tuple[FaultHealth, ...] = field(default=())
    reason: str = ""
    requirements: tuple[FaultHealth, ...] = field(default=())


@dataclass(frozen=True)
class Tracked:
    """What all tests together tell of a fault.

    Attributes
    ----------
    value, sigma
        Value and its standard deviation [-].
    doubtful
        Whether the latest test tells of another value, which is held back until the next.
    """

    value: float
    sigma: float
    doubtful: bool = False


def assess(
    estimate: Estimate, limits: HealthLimits, tracked: Mapping[str, Tracked] | None = None
) -> Health:
    """Return the health that a valid estimate tells of.

    Parameters
    ----------
    estimate
        What was found in a window.
    limits
        Where life ends.
    tracked
        What it and the tests before it tell together, by component; of others, and when None,
        the estimate holds.

    Raises
    ------
    ValueError
        When the estimate is not valid.

    Notes
    -----
    WARN when the lower 95 % bound of a fault passes a share of its limit, ERROR when its value
    passes the limit. The direction of eccentricity is no fault. The confidence is the share of
    the faults that are observable, less as the goodness of fit goes from half its limit to
    the limit. A value that is held back until the next test, and would by itself give WARN or
    ERROR, gives WARN.
    """
    if not estimate.valid:
        raise ValueError(f"no health without a valid estimate: {estimate.reason}")
    faults = tuple(
        _assess_fault(number, estimate, limits, (tracked or {}).get(fault.name))
        for number, fault in enumerate(FAULTS)
        if fault.limit is not None
    )
    known = [item for item in faults if item.level != STALE]
    unseen = {
        fault.name for fault, hidden in zip(FAULTS, estimate.unobservable, strict=True) if hidden
    }
    unknown = [item.name for item in faults if item.name in unseen]
    worst = _worst(faults)
    alarmed = worst is not None and worst.level != OK
    limit = estimate.goodness_limit
    # Nothing is known of the fit where the calibration does not tell its scatter.
    goodness = np.nan_to_num(estimate.goodness_of_fit, nan=limit)
    fit = np.interp(goodness, [limit / 2.0, limit], [1.0, 0.0])
    return Health(
        level=worst.level if worst else STALE,
        health_index=float(np.clip(1.0 - max((i.share for i in known), default=np.nan), 0.0, 1.0)),
        severity=_grade(worst),
        confidence=float(fit) * (1.0 - len(unknown) / len(faults)),
        dominant_fault=worst.name if worst and alarmed else "",
        faults=faults,
        reason="; ".join(
            filter(
                None,
                [
                    f"not observable in this window: {', '.join(unknown)}" if unknown else "",
                    estimate.reason,
                ],
            )
        ),
    )


def with_requirements(health: Health, requirements: tuple[FaultHealth, ...]) -> Health:
    """Return health with that as to required performances: the worse level and grade hold.

    Parameters
    ----------
    health
        By the faults.
    requirements
        As to each requirement.
    """
    worst = _worst(requirements)
    if worst is None:
        return replace(health, requirements=requirements)
    level = worst.level if health.level == STALE else max(health.level, worst.level)
    severity = max(health.severity, _grade(worst))
    return replace(health, level=level, severity=severity, requirements=requirements)


def _worst(items: tuple[FaultHealth, ...]) -> FaultHealth | None:
    """Return the worst of those that are known."""
    known = [item for item in items if item.level != STALE]
    return max(known, key=lambda item: (item.level, item.share), default=None)


def _grade(worst: FaultHealth | None) -> int:
    if worst is None or worst.level == OK:
        return 0
    return 1 + int(np.searchsorted(_GRADES, worst.share, "right"))


def _assess_fault(
    number: int, estimate: Estimate, limits: HealthLimits, tracked: Tracked | None
) -> FaultHealth:
    fault, value = FAULTS[number], float(estimate.faults[number])
    sigma = float(estimate.sigma[number])
    is_unknown = bool(estimate.unobservable[number])
    alone = STALE if is_unknown else _level(fault.name, value - fault.healthy, sigma, limits)
    level = alone
    if tracked is not None:
        value, sigma = tracked.value, tracked.sigma
        level = _level(fault.name, value - fault.healthy, sigma, limits)
        if tracked.doubtful and alone in (WARN, ERROR):
            level = max(level, WARN)
    limit = limits.of(fault.name)
    is_lower = value < fault.healthy
    return FaultHealth(
        fault.name,
        level,
        value,
        sigma,
        fault.healthy + (-limit if is_lower else limit),
        is_lower,
        abs(value - fault.healthy) / limit,
    )


def _level(fault_name: str, difference: float, sigma: float, limits: HealthLimits) -> int:
    distance, limit = abs(difference), limits.of(fault_name)
    if distance > limit:
        return ERROR
    if distance - ONE_SIDED_95 * sigma > limits.warn_share * limit:
        return WARN
    return OK
