# SPDX-License-Identifier: Apache-2.0
"""Computation of a unit's outlook (health and remaining life) from the growth of its faults."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.faults import COMPONENTS, ECCENTRICITY_PHASE, FAULT_NAMES
from ema_core.levels import OK
from ema_monitor.health import (
    TORQUE_PER_AMPERE,
    Health,
    HealthLimits,
    Recurrence,
    Tracked,
    assess,
    warned,
    with_requirements,
    worst_of,
)
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.growth.prediction import Fan, Prognosis, RemainingLife, TrackedFault
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.outlook import Outlook, Removal
from ema_monitor.prognosis.requirements.required_life import RequiredLife, required_life
from ema_monitor.prognosis.requirements.requirements import Requirements, Unmonitored
from ema_monitor.prognosis.sentences import SOON_HOURS
from ema_monitor.prognosis.settings import PrognosisSettings

_TIMES: Final = 30
_LEAST_SPAN_HOURS: Final = 1.0
_QUANTILE: Final = 0.05


@dataclass(frozen=True, eq=False)
class Forecaster:
    """Immutable snapshot of a unit after a test, for forecasts."""

    outlook: Outlook
    """Health and remaining life after the test."""
    tracker: Tracker | None
    """Fault growth tracker; None if the service hours are unknown."""
    limits: HealthLimits
    """Limits at which life ends."""

    def fan(self) -> Fan | None:
        """Return the quantiles of the future faults; None if the service hours are unknown."""
        if self.tracker is None:
            return None
        ahead = hours_ahead(self.outlook.rul, self.outlook.observed_hours)
        hours = ahead * np.linspace(0.0, 1.0, _TIMES)
        return self.tracker.fan(hours, self.outlook.future)


def hours_ahead(life: RemainingLife, observed_hours: float) -> float:
    """Return the time span of a forecast plot [h]; it includes a near end of life.

    The span is limited by the time for which the unit has been observed.

    Parameters
    ----------
    life
        Remaining life of the unit.
    observed_hours
        Hours over which the unit has been observed [h].
    """
    span = max(observed_hours, _LEAST_SPAN_HOURS)
    ahead = min(1.1 * life.hours_95, 2.5 * life.hours_50, 2.0 * span) if life.known else 0.0
    return max(ahead, 0.06 * span)


def outlook_of(
    growth: GrowthRecord,
    settings: PrognosisSettings,
    requirements: Requirements | Unmonitored,
    shown: Mapping[str, Estimate],
    recent: Collection[str],
    intermittent: Mapping[str, Recurrence],
) -> Outlook:
    """Return the outlook (health and remaining life) after the latest test, without events.

    Parameters
    ----------
    growth
        Growth of the unit, with at least one test.
    settings
        Limits, horizon and duty.
    requirements
        Requirements of the unit, or the reason why they cannot be monitored.
    shown
        Estimate of the latest test that showed each fault, by fault.
    recent
        Faults that a recent test has shown.
    intermittent
        Recurrence of each intermittent fault.

    Raises
    ------
    ValueError
        If there is no test.
    """
    service, limits = growth.service, settings.limits
    entry = service.latest
    if entry is None:
        raise ValueError("there is no history yet: no valid test so far")
    future = settings.scenario.future(growth.duty, settings.service.duty)
    observed, tracked = 0.0, ()
    if service.unknown:
        prognosis = Prognosis.unknown(service.unknown, limits, future)
    else:
        observed = service.hours - service.used[0].hours
        # Convert trends from growth hours to service hours.
        rates = growth.duty.present.tolist() if growth.duty else [1.0] * len(COMPONENTS)
        tracked = tuple(
            replace(item, trend=rate * item.trend)
            for item, rate in zip(growth.tracker.components(), rates, strict=True)
            if item.tests
        )
        prognosis = growth.tracker.predict(future)
    tracker = settings.tracker
    horizon = min(tracker.horizon_hours, tracker.horizon_factor * observed) / future.factor
    # Alarms must not wait for a count of service hours.
    judged = {
        item.name: Tracked(
            item.value, item.sigma, item.name in growth.doubtful, item.name in recent
        )
        for item in (tracked if growth.latest_is_used else ())
    }
    for name, last in shown.items():
        if name not in judged and last.end_ns < entry.stamp_ns:
            value, sigma = (getattr(row, name) for row in (last.faults, last.sigma))
            judged[name] = Tracked(value, sigma, is_recent=name in recent)
    health = assess(entry.estimate, limits, judged, intermittent)
    if isinstance(requirements, Unmonitored):
        required = RequiredLife.unknown(requirements.reason, settings.requirements)
    else:
        required = _required(
            growth, entry.estimate, tracked, prognosis, horizon, limits, requirements
        )
    health = with_requirements(health, required.healths)
    rul = earlier(prognosis.overall, required.overall, required.with_limits)
    worst = worst_of((*health.faults, *health.requirements))
    dominant, tests_tell = worst.name if worst and worst.level != OK else "", True
    lifetimes = levels = np.empty(0)
    if rul.known:
        by_fault = rul.criterion == prognosis.overall.criterion
        dominant = prognosis.dominant_fault if by_fault else required.dominant
        lifetimes = lifetimes_of(prognosis.samples, required.samples)
        levels = prognosis.levels if by_fault else levels
        hidden = dict(zip(FAULT_NAMES, entry.estimate.unobservable, strict=True))
        tests_tell = not hidden.get(dominant, False)
    hours_per_cycle = service.mean_hours_per_cycle or settings.service.hours_per_cycle or math.nan
    hours_per_cycle = settings.scenario.hours_per_cycle or hours_per_cycle
    hours_a_day = settings.scenario.hours_per_day or service.usage
    removal = removal_of(
        rul, lifetimes, settings.service.removal_risk, hours_per_cycle, hours_a_day
    )
    lives = {**prognosis.components, **required.lives}
    if any(item.name == TORQUE_PER_AMPERE for item in health.requirements):
        lives[TORQUE_PER_AMPERE] = RemainingLife.unknown("", "its growth is not tracked")
    return Outlook(
        stamp_ns=entry.stamp_ns,
        flight_hours=service.hours,
        cycles=entry.cycles,
        hours_per_cycle=hours_per_cycle,
        health=warned_if_due(health, removal),
        trends={item.name: item.trend for item in tracked} | dict(required.trends),
        lives=lives,
        rul_faults=prognosis.overall,
        rul_requirements=required.overall,
        rul=rul,
        dominant_fault=dominant,
        future=future,
        assumption=str(future),
        observed_hours=observed,
        horizon_hours=horizon,
        lifetimes=lifetimes,
        levels=levels,
        removal=removal,
        tests_tell=tests_tell,
        track_records={item.name: item.track_record for item in tracked},
        departure=entry.estimate.departure,
    )


def warned_if_due(health: Health, removal: Removal) -> Health:
    """Return the health, with OK raised to a warning if the unit should be removed now."""
    if health.level != OK or not removal.hours < SOON_HOURS:
        return health
    text = f"removal is due: {100.0 * removal.risk:.3g} % risk of failure in {removal.hours:.2g} h"
    reason = "; ".join(filter(None, [text, health.reason]))
    return replace(warned(health), reason=reason)


def _required(
    growth: GrowthRecord,
    estimate: Estimate,
    tracked: tuple[TrackedFault, ...],
    prognosis: Prognosis,
    horizon_hours: float,
    limits: HealthLimits,
    requirements: Requirements,
) -> RequiredLife:
    """Return the remaining life according to the requirements."""
    faults, covariance = _latest_faults(growth, estimate, tracked)
    compliance = requirements.judge(faults, covariance, warn_share=limits.warn_share)
    if growth.service.unknown or np.isnan(faults).any():
        reason = growth.service.unknown or "not all faults are observable"
        return RequiredLife.unknown(reason, requirements, compliance.healths)
    required = required_life(
        requirements, compliance, faults, growth.tracker, tracked, prognosis, limits, horizon_hours
    )
    if growth.latest_is_used:
        return required
    alone = requirements.judge(estimate.faults, estimate.covariance, warn_share=limits.warn_share)
    return replace(required, healths=alone.healths)


def _latest_faults(
    growth: GrowthRecord, estimate: Estimate, tracked: tuple[TrackedFault, ...]
) -> tuple[Array, Array]:
    """Return the fault vector, ``(8,)``, and its covariance after all tests, ``(8, 8)``.

    They are from the latest test if no fault is tracked. Unknown values are NaN.
    """
    faults = np.array(estimate.faults)
    if not tracked:
        return faults, estimate.covariance
    variance = np.where(estimate.unobservable, np.nan, np.diag(estimate.covariance))
    for item in tracked:
        number = FAULT_NAMES.index(item.name)
        faults[number], variance[number] = item.value, item.sigma**2
    if not math.isnan(growth.phase[0]):
        faults[ECCENTRICITY_PHASE], variance[ECCENTRICITY_PHASE] = growth.phase
    return faults, np.diag(variance)


def earlier(
    by_faults: RemainingLife, by_requirements: RemainingLife, together: RemainingLife
) -> RemainingLife:
    """Return the remaining life until the first of two end-of-life criteria is met.

    The shorter life determines the criterion of the result.

    Parameters
    ----------
    by_faults, by_requirements
        Lives of the same actuator.
    together
        Life until the first of both ends, computed from common samples. As it may be based on fewer
        samples, the result is limited to the shorter of both lives.
    """
    lives = [life for life in (by_faults, by_requirements) if life.known]
    if not lives:
        reasons = dict.fromkeys(filter(None, [by_faults.reason, by_requirements.reason]))
        return RemainingLife.unknown("the first fault limit or requirement", "; ".join(reasons))
    first = min(lives, key=lambda life: life.hours_50)
    every = [*lives, together] if together.known else lives
    return RemainingLife(
        True,
        min(life.hours_05 for life in every),
        min(life.hours_50 for life in every),
        min(life.hours_95 for life in every),
        first.criterion,
    )


def lifetimes_of(by_faults: Array, by_requirements: Array) -> Array:
    """Return samples of the shorter of two lives, combined by quantile (P12).

    Parameters
    ----------
    by_faults
        Samples of the life by fault limits [h], ``(n,)``; empty when it is unknown.
    by_requirements
        Samples of the life by requirement or limit [h], ``(m,)``; empty when it is unknown.

    Returns
    -------
    numpy.ndarray
        Lives in the order of ``by_faults``, infinite where neither ends [h], ``(n,)``. If one of
        the lives is unknown, the samples of the other.
    """
    if not by_requirements.size:
        return by_faults
    if not by_faults.size:
        return by_requirements
    rank = np.argsort(np.argsort(by_faults, kind="stable"), kind="stable")
    at = rank * by_requirements.size // by_faults.size
    return np.minimum(by_faults, np.sort(by_requirements)[at])


def removal_of(
    life: RemainingLife, lifetimes: Array, risk: float, hours_per_cycle: float, hours_a_day: float
) -> Removal:
    """Return the removal deadline of a unit; its hours are NaN if the remaining life is unknown.

    Parameters
    ----------
    life
        Remaining life of the unit.
    lifetimes
        Equally probable remaining lives [h], ``(n,)``; empty when it is unknown.
    risk
        Accepted probability of a failure before the removal [-].
    hours_per_cycle, hours_a_day
        Service hours per test cycle [h] and per day [h/d]; NaN if unknown.
    """
    if not life.known or not lifetimes.size:
        return Removal(risk, hours_a_day=hours_a_day)
    hours = float(np.quantile(lifetimes, risk, method="inverted_cdf"))
    # The published quantiles may be based on fewer samples; do not contradict them.
    if risk <= _QUANTILE:
        hours = min(hours, life.hours_05)
    if risk >= _QUANTILE:
        hours = max(hours, life.hours_05)
    return Removal(risk, hours, hours / hours_per_cycle, hours / hours_a_day, hours_a_day)
