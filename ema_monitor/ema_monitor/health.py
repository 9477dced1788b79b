# SPDX-License-Identifier: Apache-2.0
"""Health of an actuator from an estimate: levels, health index and severity (docs/faults.md)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np

from ema_core.causes import CauseEstimate
from ema_core.display import Displayed
from ema_core.expecting import require_type
from ema_core.faults import (
    FAULT_BY_NAME,
    FAULT_NAMES,
    FAULTS,
    KINDS,
    LIMITS,
    kind_of,
    settings_by_kind,
)
from ema_core.labels import label_of
from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN
from ema_core.quantity import Checked, quantity
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.identification.search_settings import MOST_UNEXPLAINED
from ema_monitor.joint.comparison import Comparison
from ema_monitor.joint.wording import why_no_level
from ema_monitor.model.deviations import USUAL_SIGMA
from ema_monitor.quantities import TORQUE
from ema_monitor.unusual_causes import ONE_SIDED_95, TORQUE_CONSTANT, torque_change, unusual_causes

TORQUE_PER_AMPERE: Final = "torque_per_ampere"
"""Name of an additional requirement, the remaining share of the torque per ampere [-]."""

USUAL_TORQUE_CHANGE: Final = USUAL_SIGMA[TORQUE_CONSTANT]
"""Standard deviation of the torque per ampere due to the temperature of the magnets [-]."""

BEST_INDEX_WITH_WARNING: Final = 0.99
"""Largest health index at a level of WARN or ERROR [-]."""

_GRADES: Final = (0.5, 0.8, 1.0)


def _limit_of(kind: str) -> Any:
    fault = KINDS[kind][0]
    suffix = f", in both directions from {fault.healthy:g}" if fault.is_two_sided else ""
    if len(KINDS[kind]) > 1:
        suffix = ", each phase"
    text = f"limit of {label_of(kind)}{suffix}"
    return quantity(LIMITS[kind], "-", 1e-3, 1.0 - fault.healthy, text)


@dataclass(frozen=True)
class HealthLimits(Checked, settings_by_kind("_LimitByKind", float, _limit_of)):
    """End-of-life limits, and the share of a limit at which a warning is given.

    There is one limit for each kind of fault: the largest distance of a component from its healthy
    value [-].

    Raises
    ------
    ValueError
        If a value is outside its range; the message names it.
    """

    warn_share: float = quantity(
        0.2, "-", 1e-3, 1.0, "share of a limit at which a fault's lower 95 % bound gives a warning"
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
        """Relative change of Coulomb friction at the warning limit of the friction fault [-]."""
        return 2.0 * self.warn_share * self.of("friction")


class Recurrence(NamedTuple):
    """How often a fault exceeded its limit in the latest tests."""

    times: int
    tests: int
    """Number of tests in which the fault exceeded its limit, and number of tests considered."""
    worst: float
    """Largest distance of the fault from healthy [-]."""
    tests_left: int = 0
    """Tests without the fault that end the warning after a single occurrence; 0 if only a person
    ends it."""


@dataclass(frozen=True)
class FaultHealth:
    """Health with respect to one fault."""

    name: str
    """Component of the fault vector."""
    level: int
    """``OK``, ``WARN`` or ``ERROR``; ``STALE`` if the fault is unknown."""
    value: float
    sigma: float
    """Estimated value and its standard deviation [-]; sigma is NaN if unobservable."""
    limit: float
    warn_limit: float
    """End-of-life limit, and the limit above which the lower 95 % bound gives a warning [-]."""
    limit_is_lower: bool
    """Whether life ends below the limit rather than above."""
    share: float
    """Distance from the healthy value, relative to the distance of the limit [-]."""
    held: float = math.nan
    """Value of the latest test [-] that the next test must confirm: it disagrees with earlier
    tests, and one of the values gives a warning or failure. NaN otherwise."""
    unconfirmed: int | None = None
    """Lower level that the latest test shows and later tests must confirm; None otherwise."""
    recurrence: Recurrence | None = None
    """Recurrence of the fault, if it is intermittent and not acknowledged."""


@dataclass(frozen=True, repr=False)
class Health(Displayed):
    """Health of an actuator."""

    level: int
    """Worst level of all known faults and requirements. ``STALE`` if nothing is known, or if a
    comparison does not show that the unit is healthy."""
    health_index: float
    """Minimum of 1 - share over the faults [-], clipped to [0, 1], and at most 0.99 with a warning.
    NaN if no fault is known or a comparison gives no level."""
    severity: int
    """Grade from 0 (as new) to 4 (at or above the limit)."""
    confidence: float
    """Share of observable faults, reduced for a poor goodness of fit [-]. For a comparison, the
    share of judged quantities; 0 when it gives no level."""
    dominant_fault: str
    """Fault nearest to its limit; empty if no fault gives a warning."""
    faults: tuple[FaultHealth, ...] = field(default=())
    """Health with respect to each fault."""
    reason: str = ""
    """Reasons why faults or the level are unknown, and reasons for warnings; may be empty."""
    requirements: tuple[FaultHealth, ...] = field(default=())
    """Health with respect to each requirement; empty if there are none."""

    @property
    def brief(self) -> str:
        """Level, dominant fault and, if known, the health index."""
        index = "" if math.isnan(self.health_index) else f"health index {self.health_index:.2f}"
        parts = f"level {LEVEL_NAMES[self.level]}", index, label_of(self.dominant_fault)
        return ", ".join(filter(None, parts))

    def without_ok(self) -> "Health":
        """Return the health with STALE instead of OK for every fault and requirement."""

        def unsure(items: tuple[FaultHealth, ...]) -> tuple[FaultHealth, ...]:
            return tuple(replace(item, level=STALE) if item.level == OK else item for item in items)

        faults, requirements = unsure(self.faults), unsure(self.requirements)
        return replace(self, faults=faults, requirements=requirements)


@dataclass(frozen=True)
class Tracked:
    """Value of a fault, estimated from all tests."""

    value: float
    sigma: float
    """Value and its standard deviation [-]."""
    doubtful: bool = False
    """Whether the latest test disagrees and needs confirmation by the next test."""
    is_recent: bool = True
    """Whether a recent test has determined the fault; otherwise its level cannot be OK."""


def assess(
    estimate: Estimate,
    limits: HealthLimits,
    tracked: Mapping[str, Tracked] | None = None,
    intermittent: Mapping[str, Recurrence] | None = None,
) -> Health:
    """Return the health of an actuator, assessed from a valid estimate.

    Parameters
    ----------
    estimate
        Estimate of a window.
    limits
        Limits at which life ends.
    tracked
        Values tracked over all tests so far, by component. The estimate is used for missing
        components, and for None.
    intermittent
        Intermittent faults. Each raises the level to at least WARN, and to ERROR in a test that
        shows it beyond its limit.

    Raises
    ------
    ValueError
        If the estimate is not valid, or an argument has a wrong type.

    Notes
    -----
    The level is WARN if the lower 95 % bound of a fault exceeds a share of its limit, or if the
    estimate has departed, and ERROR if the value of a fault exceeds its limit. A fault is STALE if
    no recent test could determine it, or if its upper 95 % bound exceeds the limit. For a modelled
    drive, OK requires every fault: if a fault is STALE, the level is STALE and the health index
    unknown, unless the level is WARN or ERROR. The direction of eccentricity is not a fault.

    The confidence is the share of faults that the estimate and recent tests can determine. If the
    goodness of fit, where larger is worse, exceeds half its limit, the confidence is reduced by
    this excess or by the unexplained share, whichever gives the smaller reduction. It is zero if
    both are at their limits. If the estimate and the tracker both find a fault healthy, the smaller
    sigma is used. A value that is held back until the next test is WARN if it would be WARN or
    ERROR by itself.

    A hidden cause beyond its usual range, or in a window that fits poorly, gives a WARN
    (`unusual_causes`). A torque constant below its healthy value counts as a loss of torque per
    ampere, in health index and requirements.

    If the estimate has a comparison, OK requires that the comparison judges Coulomb friction, with
    a smallest detectable change below the warning limit. Otherwise the level is STALE, and health
    index and confidence are unknown.
    """
    require_type("estimate", estimate, Estimate, "identify(window) returns one")
    require_type("limits", limits, HealthLimits)
    if not estimate.valid:
        raise ValueError(f"no health without a valid estimate: {estimate.reason}")
    faults = tuple(
        _recurring(
            _assess_fault(number, estimate, limits, (tracked or {}).get(fault.name)),
            _level_alone(number, estimate, limits),
            (intermittent or {}).get(fault.name),
            limits,
        )
        for number, fault in enumerate(FAULTS)
        if fault.limit is not None
    )
    judged = [item for item in faults if item.level != STALE]
    hidden = dict(zip(FAULT_NAMES, estimate.unobservable, strict=True))
    unknown = [item.name for item in faults if hidden[item.name]]
    missing = [item.name for item in faults if item.level == STALE]
    comparison = estimate.comparison
    unseen = f"not observable in this window: {', '.join(unknown)}" if unknown else ""
    unseen = "" if comparison is not None else _joined(why_not_shown(missing), unseen)
    worst = worst_of(faults)
    limit = estimate.goodness_limit
    # The fit is unknown if the calibration has no scatter.
    goodness = np.nan_to_num(estimate.goodness_of_fit, nan=limit)
    fit = np.interp(goodness, [limit / 2.0, limit], [1.0, 0.0])
    if np.isfinite(estimate.unexplained_share):
        fit = max(fit, 1.0 - estimate.unexplained_share / MOST_UNEXPLAINED)
    level, severity = worst.level if worst else STALE, _grade(worst)
    index = float(np.clip(1.0 - max((i.share for i in judged), default=np.nan), 0.0, 1.0))
    if missing and comparison is None and level == OK:
        level, index = STALE, math.nan
    reasons = [unseen, estimate.reason]
    if estimate.verdict == Verdict.DEPARTED:
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
    """Return health including torque per ampere and warnings for unusual hidden causes."""
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
    """Return health with respect to torque per ampere, reduced by a weaker motor or magnets.

    The result is empty if the torque per ampere is unknown or has not fallen. Lost turns in all
    phases count here as well, if the window cannot separate them from a weaker motor.
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
    """Return a phrase that lists faults no recent test has shown, and the motion that shows them.

    The phrase is empty if ``names`` is empty.
    """
    by_motion: dict[str, list[str]] = {}
    for name in names:
        fault = FAULT_BY_NAME[name]
        by_motion.setdefault(fault.shown_by, []).append(fault.label)
    parts = [f"{', '.join(labels)} (shown by {motion})" for motion, labels in by_motion.items()]
    return f"no recent test has shown {' and '.join(parts)}" if parts else ""


def shows(estimate: Estimate, name: str, limits: HealthLimits) -> bool:
    """Return whether an estimate alone determines if a fault has reached its limit."""
    return estimate.valid and _level_alone(FAULT_NAMES.index(name), estimate, limits) != STALE


def _joined(*texts: str) -> str:
    return "; ".join(filter(None, texts))


def _by_comparison(health: Health, comparison: Comparison, limits: HealthLimits) -> Health:
    """Return health with the level, index and confidence that a comparison justifies."""
    items = (*health.faults, *health.requirements)
    share = max((item.share for item in items if item.level != STALE), default=math.nan)
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
        reason=missing,  # the comparison itself reports the other reasons
    )


def warned(health: Health) -> Health:
    """Return the health with at least a warning, and a matching health index and severity."""
    level = WARN if health.level in (OK, STALE) else health.level
    return _limited_by_warning(replace(health, level=level, severity=max(health.severity, 1)))


def _limited_by_warning(health: Health) -> Health:
    """Return the health, with a health index of at most 0.99 if there is a warning."""
    if health.level in (WARN, ERROR) and health.health_index > BEST_INDEX_WITH_WARNING:
        return replace(health, health_index=BEST_INDEX_WITH_WARNING)
    return health


def with_requirements(health: Health, requirements: tuple[FaultHealth, ...]) -> Health:
    """Return the health extended by requirements; the worse level and severity apply.

    If the level of the faults is STALE and the worst requirement is OK, the level remains STALE,
    and all requirements become STALE.

    Parameters
    ----------
    health
        Health from the faults.
    requirements
        Health with respect to each requirement to add.
    """
    worst = worst_of(requirements)
    requirements = (*health.requirements, *requirements)
    if worst is None:
        return replace(health, requirements=requirements)
    if health.level == STALE and worst.level == OK:
        # The requirements are computed from faults, which are unknown.
        stale = tuple(replace(item, level=STALE) for item in requirements)
        return replace(health, requirements=stale)
    level = worst.level if health.level == STALE else max(health.level, worst.level)
    severity = max(health.severity, _grade(worst))
    return _limited_by_warning(
        replace(health, level=level, severity=severity, requirements=requirements)
    )


def _torque_per_ampere(
    comparison: Comparison, measured: Sequence[CauseEstimate], limits: HealthLimits
) -> tuple[FaultHealth, ...]:
    """Return health with respect to the torque per ampere of an unknown drive.

    The result is empty if the change of the torque per ampere is unknown.

    Turns may be lost in all phases, not only in a single phase. Hot magnets are weaker, which is
    not a fault: unless their effect was measured, it is part of sigma.
    """
    change, sigma = _torque_change(comparison)
    if math.isnan(change):
        return ()
    is_measured = any(cause.name == "torque_constant" for cause in measured)
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
    """Return the relative change of torque per ampere and its sigma; NaN if unknown.

    The change is unknown if the record does not separate it from a rival quantity.
    """
    torque = comparison[TORQUE]
    if not torque.is_judged or torque.rivals:
        return math.nan, math.nan
    return torque.change, (torque.high - torque.low) / (2.0 * ONE_SIDED_95)


def worst_of(items: tuple[FaultHealth, ...]) -> FaultHealth | None:
    """Return the worst fault or requirement that is not STALE, or None."""
    judged = [item for item in items if item.level != STALE]
    return max(judged, key=lambda item: (item.level, item.share), default=None)


def _grade(worst: FaultHealth | None) -> int:
    if worst is None or worst.level == OK:
        return 0
    return 1 + int(np.searchsorted(_GRADES, worst.share, "right"))


def _assess_fault(
    number: int, estimate: Estimate, limits: HealthLimits, tracked: Tracked | None
) -> FaultHealth:
    fault, value, sigma = FAULTS[number], estimate.faults[number], estimate.sigma[number]
    is_unknown = bool(estimate.unobservable[number])
    level_alone = _level_alone(number, estimate, limits)
    level, held = level_alone, math.nan
    if tracked is not None:
        # If both find the fault healthy, all tests together are at least as certain as this test.
        both_healthy = value == fault.healthy and abs(tracked.value - value) < sigma
        sigma = min(sigma, tracked.sigma) if both_healthy else tracked.sigma
        value = tracked.value
        level = _level(fault.name, value - fault.healthy, sigma, limits)
        if level == OK and not tracked.is_recent:
            level = STALE
        if tracked.doubtful and not is_unknown and {level_alone, level} & {WARN, ERROR}:
            level, held = ERROR if level == ERROR else WARN, float(estimate.faults[number])
    signed_limit = math.copysign(limits.of(fault.name), value - fault.healthy)
    ends = fault.healthy + signed_limit, fault.healthy + limits.warn_share * signed_limit
    share = (value - fault.healthy) / signed_limit
    return FaultHealth(fault.name, level, value, sigma, *ends, signed_limit < 0.0, share, held)


def _level_alone(number: int, estimate: Estimate, limits: HealthLimits) -> int:
    """Return the level of a fault according to the estimate alone."""
    if estimate.unobservable[number]:
        return STALE
    fault = FAULTS[number]
    away = estimate.faults[number] - fault.healthy
    return _level(fault.name, away, estimate.sigma[number], limits)


def _recurring(
    item: FaultHealth, alone: int, recurrence: Recurrence | None, limits: HealthLimits
) -> FaultHealth:
    """Return the health of a fault, raised to a warning or failure if it is intermittent.

    An intermittent fault has a ``recurrence``. It has failed if its level, or the level ``alone``
    of the newest estimate, is ERROR.
    """
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
