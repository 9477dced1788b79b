"""Health of an actuator from an estimate: levels, index and grade (docs/faults.md)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np

from ema_core.causes import CauseEstimate
from ema_core.faults import (
    FAULT_BY_NAME,
    FAULT_NAMES,
    FAULTS,
    KINDS,
    LIMITS,
    kind_of,
    settings_by_kind,
)
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.quantity import Checked, quantity
from ema_monitor.identification.estimate import DEPARTED, Estimate
from ema_monitor.identification.settings import MOST_UNEXPLAINED
from ema_monitor.joint.comparison import TORQUE, Comparison
from ema_monitor.joint.wording import why_no_level
from ema_monitor.model.deviations import USUAL_SIGMA
from ema_monitor.unusual_causes import ONE_SIDED_95, TORQUE_CONSTANT, torque_change, unusual_causes

TORQUE_PER_AMPERE: Final = "torque_per_ampere"
"""What is judged beside the faults: the share that is left [-]."""

USUAL_TORQUE_CHANGE: Final = USUAL_SIGMA[TORQUE_CONSTANT]
"""One sigma of what the temperature of its magnets changes the torque per ampere by [-]."""

BEST_INDEX_WITH_WARNING: Final = 0.99
"""Largest health index beside a level of WARN or ERROR [-]."""

_GRADES: Final = (0.5, 0.8, 1.0)


def _limit_of(kind: str) -> Any:
    fault = KINDS[kind][0]
    suffix = f", either way from {fault.healthy:g}" if fault.is_two_sided else ""
    if len(KINDS[kind]) > 1:
        suffix = ", each phase"
    words = kind.replace("_", " ")
    return quantity(LIMITS[kind], "-", 1e-3, 1.0 - fault.healthy, f"limit of {words}{suffix}")


@dataclass(frozen=True)
class HealthLimits(Checked, settings_by_kind("_LimitByKind", float, _limit_of)):
    """Limits at which life ends, and the share of a limit at which a warning is given.

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

    def of(self, fault_name: str) -> float:
        """Return the limit of a component's distance from its healthy value [-].

        Parameters
        ----------
        fault_name
            Name of the component, other than the direction of eccentricity.
        """
        return getattr(self, kind_of(fault_name))

    @property
    def friction_warning(self) -> float:
        """Relative change of Coulomb friction at which a warning is given [-]: 2 k of the fault."""
        return 2.0 * self.warn_share * self.of("friction")


class Recurrence(NamedTuple):
    """How often a fault that comes and goes was beyond its limit."""

    times: int
    tests: int
    """In how many of how many latest tests it was beyond its limit."""
    worst: float
    """Its largest distance from healthy [-]."""


@dataclass(frozen=True)
class FaultHealth:
    """Health with regard to one fault."""

    name: str
    """Component of the fault vector."""
    level: int
    """``OK``, ``WARN`` or ``ERROR``; ``STALE`` when the fault is unknown."""
    value: float
    sigma: float
    """Estimate and its standard deviation [-]; sigma is NaN when unobservable."""
    limit: float
    warn_limit: float
    """Values at which life ends, and from which on its lower 95 % bound gives a warning [-]."""
    limit_is_lower: bool
    """Whether life ends below the limit rather than above."""
    share: float
    """Share of the way from healthy to the limit [-]."""
    held: float = math.nan
    """Value of the latest test [-], where the tests before disagree and either gives a warning or
    failure: it is held until the next one confirms it; else NaN."""
    unconfirmed: int | None = None
    """Lower level that the latest test shows, and later ones have to confirm; None for none."""
    recurrence: Recurrence | None = None
    """How often it was beyond its limit, if it comes and goes and nobody has acknowledged that."""


@dataclass(frozen=True)
class Health:
    """Health of an actuator."""

    level: int
    """Worst of the known faults and requirements; ``STALE`` when none is known, or when a
    comparison does not show that the unit is healthy."""
    health_index: float
    """Least of 1 - share over the faults [-], clipped to [0, 1], and at most 0.99 beside a warning;
    NaN when no fault is known, or a comparison gives no level."""
    severity: int
    """Grade from 0 (as new) to 4 (at or above the limit)."""
    confidence: float
    """Share of observable faults, reduced for a poor goodness of fit [-]; of a comparison, share of
    the judged quantities, and 0 when it gives no level."""
    dominant_fault: str
    """Fault nearest to its limit; empty when none gives a warning."""
    faults: tuple[FaultHealth, ...] = field(default=())
    """Health with regard to each fault."""
    reason: str = ""
    """What is unknown, and why; empty when nothing is."""
    requirements: tuple[FaultHealth, ...] = field(default=())
    """Health with regard to each requirement; empty when there is none."""

    def without_ok(self) -> "Health":
        """Return health in which no fault and no requirement is OK: those are STALE."""

        def unsure(items: tuple[FaultHealth, ...]) -> tuple[FaultHealth, ...]:
            return tuple(replace(one, level=STALE) if one.level == OK else one for one in items)

        faults, requirements = unsure(self.faults), unsure(self.requirements)
        return replace(self, faults=faults, requirements=requirements)


@dataclass(frozen=True)
class Tracked:
    """A fault as estimated from all tests."""

    value: float
    sigma: float
    """Value and its standard deviation [-]."""
    doubtful: bool = False
    """Whether the latest test disagrees, and is held until the next one."""
    is_recent: bool = True
    """Whether a recent test has shown the fault: without one, it is not OK."""


def assess(
    estimate: Estimate,
    limits: HealthLimits,
    tracked: Mapping[str, Tracked] | None = None,
    intermittent: Mapping[str, Recurrence] | None = None,
) -> Health:
    """Return the health after a valid estimate.

    Parameters
    ----------
    estimate
        Estimate of a window.
    limits
        Limits at which life ends.
    tracked
        Values tracked over all tests so far, by component; for others, and when None, the
        estimate is used.
    intermittent
        Faults that come and go: WARN at least, ERROR in a test that shows them beyond their limit.

    Raises
    ------
    ValueError
        When the estimate is not valid.

    Notes
    -----
    WARN when the lower 95 % bound of a fault exceeds a share of its limit, or the estimate has
    departed; ERROR when a fault's value exceeds the limit. A fault is STALE when no recent test has
    shown it, or its upper 95 % bound exceeds the limit. Of a modelled drive, OK needs every fault:
    with a STALE one, the level is STALE and the health index unknown, unless it is WARN or ERROR.
    The direction of eccentricity is no fault.

    The confidence is the share of faults that the estimate and recent tests show. Where the
    goodness of fit exceeds half its limit it is reduced, by the excess or by the unexplained share,
    whichever reduces less; at both limits it is zero. A fault that the estimate sets to healthy,
    and that was tracked there, has the smaller sigma of both. A value that is held until the next
    test, and by itself would be WARN or ERROR, is WARN.

    A hidden cause beyond its usual range, or of a window that fits poorly, is a WARN of its own
    (`unusual_causes`). A torque constant below its healthy value counts as a loss of torque per
    ampere, in index and requirements.

    If the estimate has a comparison, OK needs a judgement of Coulomb friction whose smallest
    detectable change is below the warning limit. Otherwise the level is STALE, and health index and
    confidence are unknown.
    """
    if not estimate.valid:
        raise ValueError(f"no health without a valid estimate: {estimate.reason}")
    faults = tuple(
        _recurring(
            _assess_fault(number, estimate, limits, (tracked or {}).get(fault.name)),
            _alone(number, estimate, limits),
            (intermittent or {}).get(fault.name),
            limits,
        )
        for number, fault in enumerate(FAULTS)
        if fault.limit is not None
    )
    known = [item for item in faults if item.level != STALE]
    hidden = dict(zip(FAULT_NAMES, estimate.unobservable, strict=True))
    unknown = [item.name for item in faults if hidden[item.name]]
    missing = [item.name for item in faults if item.level == STALE]
    comparison = estimate.comparison
    unseen = f"not observable in this window: {', '.join(unknown)}" if unknown else ""
    unseen = "" if comparison is not None else _joined(why_not_shown(missing), unseen)
    worst = worst_of(faults)
    limit = estimate.goodness_limit
    # The fit is unknown when the calibration has no scatter.
    goodness = np.nan_to_num(estimate.goodness_of_fit, nan=limit)
    fit = np.interp(goodness, [limit / 2.0, limit], [1.0, 0.0])
    if np.isfinite(estimate.unexplained_share):
        fit = max(fit, 1.0 - estimate.unexplained_share / MOST_UNEXPLAINED)
    level, severity = worst.level if worst else STALE, _grade(worst)
    index = float(np.clip(1.0 - max((i.share for i in known), default=np.nan), 0.0, 1.0))
    if missing and comparison is None and level == OK:
        level, index = STALE, math.nan
    reasons = [unseen, estimate.reason]
    if estimate.verdict == DEPARTED:
        reasons.reverse()
        if level in (OK, STALE):
            level, severity = WARN, 1
    health = Health(
        level=level,
        health_index=index,
        severity=severity,
        confidence=float(fit) * (1.0 - len({*unknown, *missing}) / len(faults)),
        dominant_fault=worst.name if worst and worst.level != OK else "",
        faults=faults,
        reason="; ".join(filter(None, reasons)),
    )
    health = _limited_by_warning(health)
    if comparison is None:
        return _by_causes(health, estimate, limits)
    health = with_requirements(health, _torque_per_ampere(comparison, estimate.measured, limits))
    return _by_comparison(health, comparison, limits)


def _by_causes(health: Health, estimate: Estimate, limits: HealthLimits) -> Health:
    """Return health with the torque per ampere, and the warning of unusual hidden causes."""
    reasons = unusual_causes(estimate)
    is_unusual = TORQUE_CONSTANT in reasons
    torque = _torque_by_causes(estimate, limits, is_unusual=is_unusual)
    if torque:
        index = min(health.health_index, max(0.0, 1.0 - torque[0].share))
        index = index if math.isfinite(health.health_index) else math.nan
        health = with_requirements(replace(health, health_index=index), torque)
    if not reasons:
        return health
    return replace(warned(health), reason=_joined(*reasons.values(), health.reason))


def _torque_by_causes(
    estimate: Estimate, limits: HealthLimits, *, is_unusual: bool
) -> tuple[FaultHealth, ...]:
    """Return health with regard to a torque per ampere that a weaker motor or its magnets lower.

    As many turns of all phases may be lost as of one: a window may not separate both.
    """
    cause = torque_change(estimate)
    if cause is None or cause.value >= 0.0:
        return ()
    loss, limit = -cause.value, limits.short_circuit
    level = ERROR if loss > limit else OK
    if level == OK and is_unusual and loss > limits.warn_share * limit:
        level = WARN
    ends = 1.0 - limit, 1.0 - limits.warn_share * limit
    return (
        FaultHealth(TORQUE_PER_AMPERE, level, 1.0 - loss, cause.sigma, *ends, True, loss / limit),
    )


def why_not_shown(names: Sequence[str]) -> str:
    """Return which faults no recent test has shown, and which motion would; "" without names."""
    by_motion: dict[str, list[str]] = {}
    for name in names:
        fault = FAULT_BY_NAME[name]
        by_motion.setdefault(fault.shown_by, []).append(fault.label)
    parts = [f"{', '.join(labels)} (shown by {motion})" for motion, labels in by_motion.items()]
    return f"no recent test has shown {' and '.join(parts)}" if parts else ""


def shows(estimate: Estimate, name: str, limits: HealthLimits) -> bool:
    """Return whether an estimate by itself shows whether a fault has reached its limit."""
    return estimate.valid and _alone(FAULT_NAMES.index(name), estimate, limits) != STALE


def _joined(*texts: str) -> str:
    return "; ".join(filter(None, texts))


def _by_comparison(health: Health, comparison: Comparison, limits: HealthLimits) -> Health:
    """Return health with the level, index and confidence that a comparison justifies."""
    items = (*health.faults, *health.requirements)
    share = max((one.share for one in items if one.level != STALE), default=math.nan)
    health = replace(
        health,
        health_index=float(np.clip(1.0 - share, 0.0, 1.0)),
        confidence=len(comparison.judged) / len(comparison.quantities),
    )
    if comparison.has_departed:
        return _limited_by_warning(health)
    missing = why_no_level(comparison, limits.friction_warning)
    if not missing or health.level in (WARN, ERROR):
        return health
    return replace(
        health.without_ok(),
        level=STALE,
        health_index=math.nan,
        confidence=0.0,
        reason=missing,  # the comparison itself says the rest
    )


def warned(health: Health) -> Health:
    """Return health with a warning at least, and an index and severity to match."""
    level = WARN if health.level in (OK, STALE) else health.level
    return _limited_by_warning(replace(health, level=level, severity=max(health.severity, 1)))


def _limited_by_warning(health: Health) -> Health:
    """Return health whose index is at most 0.99 beside a warning."""
    if health.level in (WARN, ERROR) and health.health_index > BEST_INDEX_WITH_WARNING:
        return replace(health, health_index=BEST_INDEX_WITH_WARNING)
    return health


def with_requirements(health: Health, requirements: tuple[FaultHealth, ...]) -> Health:
    """Return health including further requirements, with the worse level and severity.

    Parameters
    ----------
    health, requirements
        Health by the faults, and with regard to each requirement.
    """
    worst = worst_of(requirements)
    requirements = (*health.requirements, *requirements)
    if worst is None:
        return replace(health, requirements=requirements)
    if health.level == STALE and worst.level == OK:
        # The faults that they follow from are not known.
        stale = tuple(replace(one, level=STALE) for one in requirements)
        return replace(health, requirements=stale)
    level = worst.level if health.level == STALE else max(health.level, worst.level)
    severity = max(health.severity, _grade(worst))
    return _limited_by_warning(
        replace(health, level=level, severity=severity, requirements=requirements)
    )


def _torque_per_ampere(
    comparison: Comparison, measured: Sequence[CauseEstimate], limits: HealthLimits
) -> tuple[FaultHealth, ...]:
    """Return health with regard to the torque per ampere, where the drive is unknown.

    As many turns of all phases may be lost as of one. Hot magnets are weaker too: what they lose
    is no fault, and part of the sigma unless it was measured.
    """
    change, sigma = _torque_change(comparison)
    if math.isnan(change):
        return ()
    is_measured = any(one.name == "torque_constant" for one in measured)
    sigma = sigma if is_measured else math.hypot(sigma, USUAL_TORQUE_CHANGE)
    loss, limit = -change, limits.short_circuit
    share = max(0.0, loss) / limit
    level = OK
    if loss > limit:
        level = ERROR
    elif loss - ONE_SIDED_95 * sigma > limits.warn_share * limit:
        level = WARN
    ends = 1.0 - limit, 1.0 - limits.warn_share * limit
    return (FaultHealth(TORQUE_PER_AMPERE, level, 1.0 - loss, sigma, *ends, True, share),)


def _torque_change(comparison: Comparison) -> tuple[float, float]:
    """Return relative change of the torque per ampere and its sigma; NaN if it is not known.

    A change that is not told apart from another quantity is not known.
    """
    one = comparison[TORQUE]
    if not one.is_judged or one.rivals:
        return math.nan, math.nan
    return one.change, (one.high - one.low) / (2.0 * ONE_SIDED_95)


def worst_of(items: tuple[FaultHealth, ...]) -> FaultHealth | None:
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
    fault, value, sigma = FAULTS[number], estimate.faults[number], estimate.sigma[number]
    is_unknown = bool(estimate.unobservable[number])
    alone = _alone(number, estimate, limits)
    level, held = alone, math.nan
    if tracked is not None:
        # Where both see the fault at healthy, it is known at least as well as by this test.
        agree = value == fault.healthy and abs(tracked.value - value) < sigma
        sigma = min(sigma, tracked.sigma) if agree else tracked.sigma
        value = tracked.value
        level = _level(fault.name, value - fault.healthy, sigma, limits)
        if level == OK and not tracked.is_recent:
            level = STALE
        if tracked.doubtful and not is_unknown and {alone, level} & {WARN, ERROR}:
            level, held = ERROR if level == ERROR else WARN, float(estimate.faults[number])
    way = math.copysign(limits.of(fault.name), value - fault.healthy)
    ends = fault.healthy + way, fault.healthy + limits.warn_share * way
    share = (value - fault.healthy) / way
    return FaultHealth(fault.name, level, value, sigma, *ends, way < 0.0, share, held)


def _alone(number: int, estimate: Estimate, limits: HealthLimits) -> int:
    """Return the level of a fault by the estimate alone."""
    if estimate.unobservable[number]:
        return STALE
    fault = FAULTS[number]
    away = estimate.faults[number] - fault.healthy
    return _level(fault.name, away, estimate.sigma[number], limits)


def _recurring(
    item: FaultHealth, alone: int, recurrence: Recurrence | None, limits: HealthLimits
) -> FaultHealth:
    """Return the health of a fault with what is known of its coming and going."""
    if recurrence is None:
        return item
    level = ERROR if ERROR in (item.level, alone) else WARN
    share = max(item.share, recurrence.worst / limits.of(item.name))
    return replace(item, level=level, share=share, recurrence=recurrence)


def _level(fault_name: str, difference: float, sigma: float, limits: HealthLimits) -> int:
    distance, limit = abs(difference), limits.of(fault_name)
    if distance > limit:
        return ERROR
    if distance - ONE_SIDED_95 * sigma > limits.warn_share * limit:
        return WARN
    return OK if distance + ONE_SIDED_95 * sigma <= limit else STALE
