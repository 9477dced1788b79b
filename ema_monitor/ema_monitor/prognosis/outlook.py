"""Health and remaining life of an actuator after a test."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS, ECCENTRICITY_PHASE, FAULT_NAMES
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_monitor.health import (
    TORQUE_PER_AMPERE,
    FaultHealth,
    Health,
    HealthLimits,
    Tracked,
    assess,
    with_requirements,
)
from ema_monitor.identification.estimate import FAILED, Estimate
from ema_monitor.prognosis.duty.future import FutureDuty
from ema_monitor.prognosis.growth.check import TrackRecord
from ema_monitor.prognosis.growth.prediction import Prognosis, RemainingLife, TrackedFault
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history_entry import UnusedCycle
from ema_monitor.prognosis.removal import Removal, removal_of, usage_of
from ema_monitor.prognosis.requirements.required_life import RequiredLife, required_life
from ema_monitor.prognosis.requirements.requirements import Requirements
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.prognosis.unit_event import UnitEvent

_OTHER_CLOCK_NS: Final = 365 * 86_400 * 10**9


class Claim(NamedTuple):
    """What gives a level its worth.

    Attributes
    ----------
    measured_ns
        Stamp of the newest test, valid or refused [ns]: the level is that of the unit then.
    received_ns
        When the author had that test [ns]; 0 when it is not known, as after a restart.
    author
        Node that says so; empty for a command.
    good_for_s
        How long it is good for from the test on [s]; 0 of a record, whose level is that at its end.
    """

    measured_ns: int = 0
    received_ns: int = 0
    author: str = ""
    good_for_s: float = 0.0

    @property
    def good_until_ns(self) -> int:
        """When it ends [ns]; 0 where it does not."""
        if not self.good_for_s:
            return 0
        begin_ns = self.measured_ns
        # A stamp that is ahead, or years behind, is of another clock: the test is just received.
        if self.received_ns and not 0 <= self.received_ns - begin_ns <= _OTHER_CLOCK_NS:
            begin_ns = self.received_ns
        return begin_ns + round(self.good_for_s * 1e9)


@dataclass(frozen=True)
class Outlook:
    """Health and remaining life of an actuator.

    Attributes
    ----------
    stamp_ns
        Stamp of the valid test on which the figures rest [ns].
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
    calibrations
        How the predictions of each fault held against its tests; what is not named is unknown.
    lives
        Remaining life until each fault, and each requirement, reaches its limit, by name; what is
        not named is as unknown as ``rul``.
    rul_faults, rul_requirements, rul
        Until the first fault does, the first requirement, and the earlier of both.
    dominant
        Fault or requirement that ends life first; the worst with a warning when none is known to
        end it; else empty.
    future
        What is assumed of the duty to come.
    assumption
        The same, and what else is assumed, in words.
    events
        What happened since the outlook before: what the latest test revealed, restarts,
        calibrations, and faults that are new.
    lifetimes
        Equally probable remaining lives until the earlier of both [h], ``(n,)``; empty when ``rul``
        is not known.
    levels
        Present level of the fault that ends life first in each of them [-], ``(n,)``; empty when a
        requirement ends it.
    removal
        By when to remove it.
    tests_tell
        Whether the test showed that fault.
    failed_since
        Service hour of the first of the latest tests that have all been ERROR [h]; NaN when it is
        not known, or the latest is not.
    failure
        Which failure of drive or shaft the newest test shows, in words; empty for none.
    claim
        What gives its level its worth.
    last_level
        The level that was known last, where the level is STALE.
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
    future: FutureDuty
    assumption: str
    failed_since: float = math.nan
    removal: Removal = field(default_factory=Removal)
    events: tuple[UnitEvent, ...] = field(default=(), repr=False, compare=False)
    lifetimes: NDArray[np.float64] = field(
        default_factory=lambda: np.empty(0), repr=False, compare=False
    )
    levels: NDArray[np.float64] = field(
        default_factory=lambda: np.empty(0), repr=False, compare=False
    )
    tests_tell: bool = True
    calibrations: Mapping[str, TrackRecord] = field(default_factory=dict)
    failure: str = ""
    claim: Claim = field(default_factory=Claim)
    last_level: int = STALE

    @property
    def known_level(self) -> int:
        """The level; where it is STALE, the one that was known last."""
        return self.last_level if self.health.level == STALE else self.health.level

    def stale(self, reason: str) -> "Outlook":
        """Return what is left when its level is not known any more."""
        health = replace(_without_ok(self.health), level=STALE, confidence=0.0, reason=reason)
        return replace(self, health=health, last_level=self.known_level)

    def at(self, now_ns: int) -> "Outlook":
        """Return what it is worth at a time [ns]: STALE once its claim has ended."""
        claim = self.claim
        if self.health.level == STALE or not 0 < claim.good_until_ns < now_ns:
            return self
        words = f"no valid estimate for more than {claim.good_for_s:g} s"
        late_s = (claim.received_ns - claim.measured_ns) * 1e-9
        if claim.good_until_ns < claim.received_ns:
            words += f": the newest test came {late_s:.0f} s after it was measured"
        return self.stale("; ".join(filter(None, [words, self.health.reason])))

    def after_refusal(self, test: UnusedCycle) -> "Outlook":
        """Return what is known once a later test was refused: it failed, or nothing.

        Parameters
        ----------
        test
            The newest test.
        """
        if test.verdict != FAILED:
            return self.stale(f"the newest test was refused: {test.reason}")
        life = RemainingLife.unknown("", f"it has failed: {test.reason}")
        health = replace(
            _without_ok(self.health),
            level=ERROR,
            health_index=0.0,
            severity=4,
            confidence=1.0,
            dominant_fault="",
            reason=test.reason,
        )
        return replace(
            self,
            health=health,
            rul=life,
            rul_faults=life,
            rul_requirements=life,
            lives=dict.fromkeys(self.lives, life),
            removal=Removal(),
            lifetimes=np.empty(0),
            levels=np.empty(0),
            dominant="",
            failure=test.reason,
        )

    @property
    def duty(self) -> float:
        """Growth of the faults in a future flight hour beside the duty to come [-]."""
        return self.future.factor


def _without_ok(health: Health) -> Health:
    """Return health in which nothing is said to be OK; what was found wrong stays."""

    def unsure(items: tuple[FaultHealth, ...]) -> tuple[FaultHealth, ...]:
        return tuple(replace(one, level=STALE) if one.level == OK else one for one in items)

    return replace(health, faults=unsure(health.faults), requirements=unsure(health.requirements))


def unknown_outlook(reason: str) -> Outlook:
    """Return what is published before any test, with the reason why nothing is known."""
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
        future=(future := FutureDuty.steady()),
        assumption=str(future),
    )


def outlook_of_one(estimate: Estimate, limits: HealthLimits, reason: str) -> Outlook:
    """Return health by one valid estimate alone, with the reason why there is no prognosis."""
    health = assess(estimate, limits)
    return replace(
        unknown_outlook(reason),
        stamp_ns=estimate.end_ns,
        health=health,
        dominant=health.dominant_fault,
    )


def _worst_with_warning(health: Health) -> str:
    """Return what is worst by level and share of the way to its limit; empty without a warning."""
    alarmed = [
        item for item in (*health.faults, *health.requirements) if item.level in (WARN, ERROR)
    ]
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
        samples: the result is never longer than either by itself. The criterion is that of the
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


def lifetimes_of(
    by_faults: NDArray[np.float64], by_requirements: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return samples of the life that ends with the first of two, quantile by quantile (P12).

    Parameters
    ----------
    by_faults
        Samples of the life by fault limits [h], ``(n,)``; empty when it is unknown.
    by_requirements
        Samples of the life by requirement or limit [h], ``(m,)``; empty when it is unknown.

    Returns
    -------
    numpy.ndarray
        As many as by faults and in their order, infinite where neither ends [h].
    """
    if not by_requirements.size:
        return by_faults
    if not by_faults.size:
        return by_requirements
    rank = np.argsort(np.argsort(by_faults, kind="stable"), kind="stable")
    at = rank * by_requirements.size // by_faults.size
    return np.minimum(by_faults, np.sort(by_requirements)[at])


def outlook_of(
    growth: GrowthRecord, settings: PrognosisSettings, requirements: Requirements | str
) -> Outlook:
    """Return health and remaining life after the latest test, without events.

    Parameters
    ----------
    growth
        Of the unit; with at least one test.
    settings
        Limits, horizon and duty.
    requirements
        Those of the unit, or why they cannot be monitored.

    Raises
    ------
    ValueError
        When there is no test.
    """
    service, limits = growth.service, settings.limits
    entry = service.latest
    if entry is None:
        raise ValueError("there is no history yet: no valid test so far")
    future = _future(growth, settings)
    if service.unknown:
        tracked: tuple[TrackedFault, ...] = ()
        prognosis = Prognosis.unknown(service.unknown, limits, future)
    else:
        tracked = tuple(_in_service(item, growth) for item in growth.tracker.components())
        tracked = tuple(item for item in tracked if item.tests)
        prognosis = growth.tracker.predict(future)
    # Alarms do not wait for a count.
    judged = {
        item.name: Tracked(item.value, item.sigma, item.name in growth.doubtful)
        for item in (tracked if growth.latest_is_used else ())
    }
    health = assess(entry.estimate, limits, judged)
    required = _required(growth, entry.estimate, tracked, prognosis, settings, requirements)
    health = with_requirements(health, required.healths)
    rul = earlier(prognosis.overall, required.overall, required.with_limits)
    dominant, tests_tell = _worst_with_warning(health), True
    lifetimes = levels = np.empty(0)
    if rul.known:
        by_fault = rul.criterion == prognosis.overall.criterion
        dominant = prognosis.dominant_fault if by_fault else required.dominant
        lifetimes = lifetimes_of(prognosis.samples, required.samples)
        levels = prognosis.levels if by_fault else levels
        hidden = dict(zip(FAULT_NAMES, entry.estimate.unobservable, strict=True))
        tests_tell = not hidden.get(dominant, False)
    hours_per_cycle = _hours_per_cycle(growth, settings)
    hours_a_day = usage_of(service.used)
    if settings.scenario is not None:
        hours_per_cycle = settings.scenario.hours_per_cycle or hours_per_cycle
        hours_a_day = settings.scenario.hours_per_day or hours_a_day
    return Outlook(
        stamp_ns=entry.stamp_ns,
        hours=service.hours,
        cycles=entry.cycles,
        hours_per_cycle=hours_per_cycle,
        health=health,
        trends={item.name: item.trend for item in tracked} | dict(required.trends),
        lives={**prognosis.components, **required.lives, **_not_tracked(health)},
        rul_faults=prognosis.overall,
        rul_requirements=required.overall,
        rul=rul,
        dominant=dominant,
        future=future,
        assumption=prognosis.assumption,
        lifetimes=lifetimes,
        levels=levels,
        removal=removal_of(
            rul, lifetimes, settings.service.removal_risk, hours_per_cycle, hours_a_day
        ),
        tests_tell=tests_tell,
        calibrations={item.name: item.calibration for item in tracked},
    )


def _future(growth: GrowthRecord, settings: PrognosisSettings) -> FutureDuty:
    """Return the duty to come; ValueError when a scenario cannot be compared with the past."""
    factor = settings.service.duty
    if settings.scenario is not None:
        return settings.scenario.future(growth.duty, factor)
    return growth.duty.as_flown(factor) if growth.duty else FutureDuty.steady(factor)


def _in_service(item: TrackedFault, growth: GrowthRecord) -> TrackedFault:
    """Return what is known of a component with its trend an hour of service, not of growth."""
    if growth.duty is None:
        return item
    rate = float(growth.duty.present[COMPONENTS.index(item.name)])
    return replace(item, trend=rate * item.trend, trend_sigma=rate * item.trend_sigma)


def _not_tracked(health: Health) -> dict[str, RemainingLife]:
    """Return the lives of what is judged by the latest test alone."""
    reason = "its growth is not tracked"
    return {
        item.name: RemainingLife.unknown("", reason)
        for item in health.requirements
        if item.name == TORQUE_PER_AMPERE
    }


def _required(
    growth: GrowthRecord,
    estimate: Estimate,
    tracked: tuple[TrackedFault, ...],
    prognosis: Prognosis,
    settings: PrognosisSettings,
    requirements: Requirements | str,
) -> RequiredLife:
    if isinstance(requirements, str):
        return RequiredLife.unknown(requirements, settings.requirements)
    limits = settings.limits
    faults, covariance = _latest_faults(growth, estimate, tracked)
    judgement = requirements.judge(faults, covariance, warn_share=limits.warn_share)
    if growth.service.unknown or np.isnan(faults).any():
        reason = growth.service.unknown or "not all faults are observable"
        return RequiredLife.unknown(reason, requirements, judgement.healths)
    required = required_life(
        requirements,
        judgement,
        faults,
        growth.tracker,
        tracked,
        prognosis,
        limits,
        settings.tracker,
        growth.service.hours - growth.service.used[0].hours,
    )
    if growth.latest_is_used:
        return required
    alone = requirements.judge(estimate.faults, estimate.covariance, warn_share=limits.warn_share)
    return replace(required, healths=alone.healths)


def _latest_faults(
    growth: GrowthRecord, estimate: Estimate, tracked: tuple[TrackedFault, ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return faults, ``(8,)``, and covariance by all tests; without tracked ones, by the last.

    What is unknown is NaN.
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


def _hours_per_cycle(growth: GrowthRecord, settings: PrognosisSettings) -> float:
    """Return the flight hours from a test cycle to the next [h]; NaN when not known."""
    used = growth.service.used
    cycles = used[-1].cycles - used[0].cycles if used else 0
    if cycles > 0 and (mean := (used[-1].hours - used[0].hours) / cycles) > 0.0:
        return mean
    return settings.service.hours_per_cycle or math.nan
