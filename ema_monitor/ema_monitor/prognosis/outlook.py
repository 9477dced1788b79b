"""Health and remaining life of an actuator after a test."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_core.display import Displayed
from ema_core.levels import ERROR, LEVEL_NAMES, STALE, WARN
from ema_monitor.health import Health, HealthLimits, assess
from ema_monitor.identification.estimate import DEPARTED, FAILED, Estimate
from ema_monitor.prognosis.duty.course import AS_BEFORE, STEADY, FutureDuty
from ema_monitor.prognosis.growth.check import TrackRecord
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.history_entry import UnitEvent, UnusedCycle

_OTHER_CLOCK_NS: Final = 365 * 86_400 * 10**9
_LEAST_AHEAD_NS: Final = 1_000_000_000


class Claim(NamedTuple):
    """What gives a level its worth."""

    measured_ns: int = 0
    """Stamp of the newest test, valid or refused [ns]: the level holds for the unit at that
    time."""
    received_ns: int = 0
    """When the author had that test [ns]; 0 when it is not known, as after a restart."""
    author: str = ""
    """Node that published it; empty for a command."""
    good_for_s: float = 0.0
    """How long it is good for from the test on [s]; 0 of a record, whose level is that at its
    end."""
    oldest_ns: int = 0
    """Stamp since when tests have shown every fault [ns], on which an OK rests; 0 where only the
    newest test counts."""
    is_live: bool = False
    """Whether the newest test was received while it was measured, whatever its stamp is."""

    @property
    def is_ahead(self) -> bool:
        """Whether the newest test is stamped later than it was received, by more than 1 s."""
        return 0 < self.received_ns < self.measured_ns - _LEAST_AHEAD_NS

    @property
    def is_dated(self) -> bool:
        """Whether the stamp of the newest test is by the clock of its receiver: not years ago."""
        return self.received_ns - self.measured_ns <= _OTHER_CLOCK_NS

    @property
    def begin_ns(self) -> int:
        """When the newest test was measured, by the clock of its receiver [ns]."""
        # A stamp that is ahead, or years behind, is of another clock: the test is just received.
        if self.received_ns and not 0 <= self.received_ns - self.measured_ns <= _OTHER_CLOCK_NS:
            return self.received_ns
        return self.measured_ns

    @property
    def good_until_ns(self) -> int:
        """When it ends [ns]; 0 where it does not."""
        if not self.good_for_s:
            return 0
        begin_ns = self.begin_ns
        if self.oldest_ns:
            begin_ns -= max(0, self.measured_ns - self.oldest_ns)
        return begin_ns + round(self.good_for_s * 1e9)


class Removal(NamedTuple):
    """By when to remove a unit (P27)."""

    risk: float = 0.05
    """Probability of a failure before that is accepted [-]."""
    hours: float = math.nan
    """Flight hours from the latest test on [h]; NaN when the remaining life is unknown."""
    cycles: float = math.nan
    """The same in test cycles; NaN when hours per cycle are unknown too."""
    days: float = math.nan
    """The same in days of the calendar, at the present usage; NaN when that is unknown too."""
    hours_a_day: float = math.nan
    """The present usage [h/d]."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Outlook(Displayed):
    """Health and remaining life of an actuator."""

    stamp_ns: int = 0
    """Stamp of the valid test on which the figures rest [ns]."""
    hours: float = math.nan
    """Service hours at that test [h]; NaN when unknown."""
    cycles: int = 0
    """Test cycles up to it."""
    hours_per_cycle: float = math.nan
    """Flight hours from a test cycle to the next [h]; NaN when unknown."""
    health: Health
    """Levels, index and grade."""
    trends: Mapping[str, float] = field(default_factory=dict)
    """Growth by fault and by requirement [its unit per flight hour]; missing names are unknown."""
    lives: Mapping[str, RemainingLife] = field(default_factory=dict)
    """Remaining life until each fault, and each requirement, reaches its limit, by name; missing
    names are as unknown as ``rul``."""
    rul_faults: RemainingLife
    rul_requirements: RemainingLife
    rul: RemainingLife
    """Until the first fault does, the first requirement, and the earlier of both."""
    dominant: str = ""
    """Fault or requirement that ends life first; the worst with a warning when none is known to end
    it; else empty."""
    future: FutureDuty = STEADY
    """What is assumed of the duty to come."""
    assumption: str = AS_BEFORE
    """The same, and further assumptions, in words."""
    observed_hours: float = 0.0
    """Hours over which the unit has been observed [h]."""
    horizon_hours: float = 0.0
    """Longest life that is looked ahead [h]."""
    missing_share: float = 0.0
    """Probability that a test gives no valid estimate [-]."""
    failed_since: float = math.nan
    """Service hour of the first of the latest tests that have all been ERROR [h]; NaN when it is
    not known, or the latest is not."""
    removal: Removal = field(default_factory=Removal)
    """By when to remove it."""
    events: tuple[UnitEvent, ...] = field(default=(), repr=False, compare=False)
    """Events since the previous outlook: findings of the latest test, restarts, calibrations, and
    new faults."""
    lifetimes: Array = field(default_factory=lambda: np.empty(0), repr=False, compare=False)
    """Equally probable remaining lives until the earlier of both [h], ``(n,)``; empty when ``rul``
    is not known."""
    levels: Array = field(default_factory=lambda: np.empty(0), repr=False, compare=False)
    """Present level of the fault that ends life first in each of them [-], ``(n,)``; empty when a
    requirement ends it."""
    tests_tell: bool = True
    """Whether the test showed that fault."""
    calibrations: Mapping[str, TrackRecord] = field(default_factory=dict)
    """Agreement of each fault's predictions with its tests; missing names are unknown."""
    failure: str = ""
    """Which failure of drive or shaft the newest test shows, in words; empty for none."""
    departure: str = ""
    """Unexplained difference of the newest test from healthy ones; empty without any."""
    claim: Claim = field(default_factory=Claim)
    """What gives its level its worth."""
    last_level: int = STALE
    """The level that was known last, where the level is STALE."""

    @property
    def brief(self) -> str:
        """Level, remaining life and service hours in a few words."""
        life, level = self.rul, LEVEL_NAMES[self.health.level]
        words = f"unknown ({life.reason})" if life.reason else "unknown"
        if life.known:
            hours = (life.hours_05, life.hours_50, life.hours_95)
            words = f"{' / '.join(f'{quantile:.4g}' for quantile in hours)} h (5 / 50 / 95 %)"
        return f"level {level}, remaining life {words}, {self.hours:.6g} service hours"

    @property
    def finding(self) -> str:
        """Finding of the newest test other than a fault: a failure or a departure."""
        return self.failure or self.departure

    @property
    def known_level(self) -> int:
        """The level; where it is STALE, the one that was known last."""
        return self.last_level if self.health.level == STALE else self.health.level

    def stale(self, reason: str) -> "Outlook":
        """Return the outlook with an unknown level: STALE, with the reason."""
        health = replace(self.health.without_ok(), level=STALE, confidence=0.0, reason=reason)
        return replace(self, health=health, last_level=self.known_level)

    def at(self, now_ns: int) -> "Outlook":
        """Return the outlook at a time [ns]: STALE once its claim has ended.

        It is STALE before its claim begins as well: then the clock has gone back.
        """
        claim = self.claim
        if self.health.level != STALE and claim.good_for_s and now_ns < claim.begin_ns:
            ahead_s = (claim.begin_ns - now_ns) * 1e-9
            return self.stale(f"the newest test is {ahead_s:.0f} s ahead of the clock")
        if self.health.level == STALE or not 0 < claim.good_until_ns < now_ns:
            return self
        words = f"no valid estimate for more than {claim.good_for_s:g} s"
        if 0 < claim.oldest_ns < claim.measured_ns:
            words = f"no test has shown every fault for more than {claim.good_for_s:g} s"
        late_s = (claim.received_ns - claim.measured_ns) * 1e-9
        if claim.good_until_ns < claim.received_ns:
            words += f": the newest test came {late_s:.0f} s after it was measured"
        return self.stale("; ".join(filter(None, [words, self.health.reason])))

    def after_refusal(self, test: UnusedCycle) -> "Outlook":
        """Return the outlook after a newest test that failed, departed or was refused otherwise."""
        if test.verdict != FAILED:
            stale = self.stale(f"the newest test was refused: {test.reason}")
            if test.comparison is not None:
                # The record is not judged: an earlier record's index does not describe the unit.
                stale = replace(stale, health=replace(stale.health, health_index=math.nan))
            if test.verdict != DEPARTED:
                return stale
            level = self.known_level if self.known_level in (WARN, ERROR) else WARN
            health = replace(stale.health, level=level, reason=test.reason)
            return replace(stale, health=health, departure=test.reason)
        life = RemainingLife.unknown("", f"it has failed: {test.reason}")
        health = replace(
            self.health.without_ok(),
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


def unknown_outlook(reason: str) -> Outlook:
    """Return the outlook before any test, with the reason why nothing is known."""
    health = Health(STALE, math.nan, 0, 0.0, "", reason=reason)
    life = RemainingLife.unknown("", reason)
    return Outlook(health=health, rul_faults=life, rul_requirements=life, rul=life)


def outlook_of_one(estimate: Estimate, limits: HealthLimits, reason: str) -> Outlook:
    """Return the health of a single valid estimate, with the reason for the missing prognosis."""
    health = assess(estimate, limits)
    return replace(
        unknown_outlook(reason),
        stamp_ns=estimate.end_ns,
        health=health,
        dominant=health.dominant_fault,
        departure=estimate.departure,
    )
