"""Health of an actuator from an estimate: levels, index and grade (docs/faults.md)."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ema_core.faults import FAULTS
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.quantity import check_quantities, quantity
from ema_monitor.estimate import Estimate

ONE_SIDED_95: Final = 1.645
"""Standard deviations from the mean to a one-sided 95 % bound [-]."""

_GRADES: Final = (0.5, 0.8, 1.0)


@dataclass(frozen=True)
class HealthLimits:
    """Where life ends, and how far from there a warning is due.

    Each limit is the largest distance of a fault component from its healthy value [-].

    Raises
    ------
    ValueError
        When a figure is outside its range; the message names it.
    """

    friction: float = quantity(0.5, "-", 1e-3, 1.0, "limit of friction")
    backlash: float = quantity(0.5, "-", 1e-3, 1.0, "limit of backlash")
    short_circuit: float = quantity(0.25, "-", 1e-3, 1.0, "limit of a short circuit, each phase")
    eccentricity: float = quantity(0.6, "-", 1e-3, 1.0, "limit of eccentricity")
    gain: float = quantity(0.25, "-", 1e-3, 0.5, "limit of the gain's distance from 0.5")
    warn_share: float = quantity(
        0.2, "-", 1e-3, 1.0, "share of a limit that a fault's lower 95 % bound passes at a warning"
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
        is_short = fault_name.startswith("short_circuit")
        return getattr(self, "short_circuit" if is_short else fault_name)


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
        Worst of the faults; ``STALE`` when there is nothing to go by.
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
    """

    level: int
    health_index: float
    severity: int
    confidence: float
    dominant_fault: str
    faults: tuple[FaultHealth, ...] = field(default=())
    reason: str = ""


def assess(estimate: Estimate, limits: HealthLimits) -> Health:
    """Return the health that a valid estimate tells of.

    Parameters
    ----------
    estimate
        What was found in a window.
    limits
        Where life ends.

    Raises
    ------
    ValueError
        When the estimate is not valid.

    Notes
    -----
    WARN when the lower 95 % bound of a fault passes a share of its limit, ERROR when its value
    passes the limit. The direction of eccentricity is no fault. The confidence is the share of
    the faults that are observable, less as the goodness of fit goes from half its limit to
    the limit.
    """
    if not estimate.valid:
        raise ValueError(f"no health without a valid estimate: {estimate.reason}")
    faults = tuple(
        _assess_fault(number, estimate, limits)
        for number, fault in enumerate(FAULTS)
        if fault.name != "eccentricity_phase"
    )
    known = [item for item in faults if item.level != STALE]
    unknown = [item.name for item in faults if item.level == STALE]
    worst = max(known, key=lambda item: (item.level, item.share), default=None)
    alarmed = worst is not None and worst.level != OK
    severity = 1 + int(np.searchsorted(_GRADES, worst.share, "right")) if worst and alarmed else 0
    limit = estimate.goodness_limit
    # Nothing is known of the fit where the calibration does not tell its scatter.
    goodness = np.nan_to_num(estimate.goodness_of_fit, nan=limit)
    fit = np.interp(goodness, [limit / 2.0, limit], [1.0, 0.0])
    return Health(
        level=worst.level if worst else STALE,
        health_index=float(np.clip(1.0 - max((i.share for i in known), default=np.nan), 0.0, 1.0)),
        severity=severity,
        confidence=float(fit) * len(known) / len(faults),
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


def _assess_fault(number: int, estimate: Estimate, limits: HealthLimits) -> FaultHealth:
    fault, value = FAULTS[number], float(estimate.faults[number])
    sigma = float(estimate.sigma[number])
    distance, limit = abs(value - fault.healthy), limits.of(fault.name)
    is_lower = value < fault.healthy
    if estimate.unobservable[number]:
        level = STALE
    elif distance > limit:
        level = ERROR
    elif distance - ONE_SIDED_95 * sigma > limits.warn_share * limit:
        level = WARN
    else:
        level = OK
    return FaultHealth(
        fault.name,
        level,
        value,
        sigma,
        fault.healthy + (-limit if is_lower else limit),
        is_lower,
        distance / limit,
    )
