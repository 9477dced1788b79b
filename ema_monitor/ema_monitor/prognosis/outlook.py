# SPDX-License-Identifier: Apache-2.0
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
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.prognosis.duty.course import AS_BEFORE, STEADY, FutureDuty
from ema_monitor.prognosis.events import UnitEvent
from ema_monitor.prognosis.growth.check import TrackRecord
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.history_entry import UnusedCycle
from ema_monitor.reasons import Learning

_OTHER_CLOCK_NS: Final = 365 * 86_400 * 10**9
_LEAST_AHEAD_NS: Final = 1_000_000_000


class Claim(NamedTuple):
    """Origin and validity of a published health level."""

    tested_ns: int = 0
    """Stamp of the newest test, valid or refused [ns]: the level describes the unit at that
    time."""
    received_ns: int = 0
    """Time at which the author received the newest test [ns]; 0 if unknown, as after a restart."""
    author: str = ""
    """Node that published the level; empty for a command."""
    good_for_s: float = 0.0
    """Validity of the level after the test [s]; 0 for a record, whose level does not expire."""
    oldest_ns: int = 0
    """Stamp [ns] since which tests have shown every fault, as OK requires; 0 if only the newest
    test counts."""
    is_live: bool = False
    """Whether the newest test was received while it was measured, regardless of its stamp."""

    @property
    def is_ahead(self) -> bool:
        """Whether the newest test is stamped later than it was received, by more than 1 s."""
        return 0 < self.received_ns < self.tested_ns - _LEAST_AHEAD_NS

    @property
    def is_dated(self) -> bool:
        """Whether the stamp of the newest test is at most a year behind the receiver's clock."""
        return self.received_ns - self.tested_ns <= _OTHER_CLOCK_NS

    @property
    def begin_ns(self) -> int:
        """Time at which the newest test was measured [ns], on the receiver's clock."""
        # A stamp that is ahead, or years behind, comes from another clock: use the reception time.
        if self.received_ns and not 0 <= self.received_ns - self.tested_ns <= _OTHER_CLOCK_NS:
            return self.received_ns
        return self.tested_ns

    @property
    def good_until_ns(self) -> int:
        """Time at which the level expires [ns]; 0 if it does not expire."""
        if not self.good_for_s:
            return 0
        begin_ns = self.begin_ns
        if self.oldest_ns:
            begin_ns -= max(0, self.tested_ns - self.oldest_ns)
        return begin_ns + round(self.good_for_s * 1e9)


class Removal(NamedTuple):
    """Removal deadline of a unit (P27)."""

    risk: float = 0.05
    """Accepted probability of a failure before the removal [-]."""
    hours: float = math.nan
    """Service hours from the latest test to the removal [h]; NaN when the remaining life is
    unknown."""
    cycles: float = math.nan
    """Test cycles to the removal; NaN when ``hours`` or the hours per cycle are unknown."""
    days: float = math.nan
    """Calendar days to the removal at the present usage; NaN when ``hours`` or the usage is
    unknown."""
    hours_a_day: float = math.nan
    """Present usage [h/d]; NaN when unknown."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Outlook(Displayed):
    """Health and remaining life of an actuator."""

    stamp_ns: int = 0
    """Stamp of the latest valid test [ns], from which all values are computed."""
    flight_hours: float = math.nan
    """Service hours at the latest valid test [h]; NaN if unknown."""
    cycles: int = 0
    """Number of test cycles up to the latest valid test."""
    hours_per_cycle: float = math.nan
    """Service hours per test cycle [h]; NaN if unknown."""
    health: Health
    """Levels, health index and severity."""
    trends: Mapping[str, float] = field(default_factory=dict)
    """Growth rate of each fault and requirement, in its unit per service hour, if known."""
    lives: Mapping[str, RemainingLife] = field(default_factory=dict)
    """Remaining life until each fault or requirement reaches its limit, by name; for missing names,
    ``rul`` has the reason."""
    rul_faults: RemainingLife
    """Remaining life until the first fault reaches its limit."""
    rul_requirements: RemainingLife
    """Remaining life until the first requirement fails."""
    rul: RemainingLife
    """The shorter of ``rul_faults`` and ``rul_requirements``."""
    dominant_fault: str = ""
    """Fault or requirement that ends life first. If the life is unknown, the worst fault or
    requirement with a warning; empty without a warning."""
    future: FutureDuty = STEADY
    """Assumed future duty."""
    assumption: str = AS_BEFORE
    """Assumed future duty and further assumptions, as a phrase."""
    observed_hours: float = 0.0
    """Hours over which the unit has been observed [h]."""
    horizon_hours: float = 0.0
    """Horizon of the prognosis [h]: the longest life that is published."""
    missing_share: float = 0.0
    """Probability that a test gives no valid estimate [-]."""
    failed_since: float = math.nan
    """Service hour at which the present run of tests with ERROR began [h]; NaN when unknown, or
    if the level is not ERROR."""
    removal: Removal = field(default_factory=Removal)
    """Removal deadline."""
    events: tuple[UnitEvent, ...] = field(default=(), repr=False, compare=False)
    """Events since the previous outlook: findings of the latest test, restarts, calibrations, and
    new faults."""
    lifetimes: Array = field(default_factory=lambda: np.empty(0), repr=False, compare=False)
    """Equally probable remaining lives [h], ``(n,)``; empty when ``rul`` is not known."""
    levels: Array = field(default_factory=lambda: np.empty(0), repr=False, compare=False)
    """Present distance of the dominant fault from healthy in each of ``lifetimes`` [-], ``(n,)``;
    empty when a requirement is dominant."""
    tests_tell: bool = True
    """Whether the latest test showed the dominant fault."""
    track_records: Mapping[str, TrackRecord] = field(default_factory=dict)
    """Scores of each fault's past predictions, if known."""
    failure: str = ""
    """Failure of drive, sensor or shaft in the newest test; empty if there is none."""
    departure: str = ""
    """Unexplained difference from healthy tests in the newest test, or a difference or failure in
    an earlier test whose end is not confirmed yet; empty if there is none."""
    claim: Claim = field(default_factory=Claim)
    """Origin and validity of the level."""
    last_level: int = STALE
    """Last known level if the level is STALE."""

    @property
    def brief(self) -> str:
        """Summary of level, remaining life and, if known, service hours."""
        text = f"level {LEVEL_NAMES[self.health.level]}, remaining life {self.rul.brief}"
        hours = self.flight_hours
        return text if math.isnan(hours) else f"{text}, {hours:.6g} service hours"

    @property
    def finding(self) -> str:
        """Failure or departure in the newest test; empty if there is none."""
        return self.failure or self.departure

    @property
    def known_level(self) -> int:
        """The level; if it is STALE, the last known level."""
        return self.last_level if self.health.level == STALE else self.health.level

    def stale(self, reason: str) -> "Outlook":
        """Return the outlook with its level set to STALE for the given reason."""
        health = replace(self.health.without_ok(), level=STALE, confidence=0.0, reason=reason)
        return replace(self, health=health, last_level=self.known_level)

    def at(self, now_ns: int) -> "Outlook":
        """Return the outlook at ``now_ns`` [ns]; its level is STALE once expired.

        It is also STALE before the newest test, because the clock must have been set back.
        """
        claim = self.claim
        if self.health.level != STALE and claim.good_for_s and now_ns < claim.begin_ns:
            ahead_s = (claim.begin_ns - now_ns) * 1e-9
            return self.stale(f"the newest test is {ahead_s:.0f} s ahead of the clock")
        if self.health.level == STALE or not 0 < claim.good_until_ns < now_ns:
            return self
        text = f"no valid estimate for more than {claim.good_for_s:g} s"
        if 0 < claim.oldest_ns < claim.tested_ns:
            text = f"no test has shown every fault for more than {claim.good_for_s:g} s"
        late_s = (claim.received_ns - claim.tested_ns) * 1e-9
        if claim.good_until_ns < claim.received_ns:
            text += f": the newest test came {late_s:.0f} s after it was measured"
        return self.stale("; ".join(filter(None, [text, self.health.reason])))

    def after_refusal(self, test: UnusedCycle) -> "Outlook":
        """Return the outlook after a newer test that was refused."""
        if test.verdict != Verdict.FAILED:
            is_learning = any(isinstance(reason, Learning) for reason in test.reasons)
            words = "" if is_learning else "the newest test was refused: "
            stale = self.stale(f"{words}{test.reason}")
            if test.comparison is not None:
                # The record was not judged: the index of an earlier record does not describe it.
                stale = replace(stale, health=replace(stale.health, health_index=math.nan))
            if test.verdict != Verdict.DEPARTED:
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
            dominant_fault="",
            failure=test.reason,
        )


def unknown_outlook(reason: str) -> Outlook:
    """Return the outlook of a unit without tests, with the reason why it is unknown."""
    health = Health(STALE, math.nan, 0, 0.0, "", reason=reason)
    life = RemainingLife.unknown("", reason)
    return Outlook(health=health, rul_faults=life, rul_requirements=life, rul=life)


def outlook_of_one(estimate: Estimate, limits: HealthLimits, reason: str) -> Outlook:
    """Return the outlook of a single valid estimate, with the reason why it has no prognosis."""
    health = assess(estimate, limits)
    return replace(
        unknown_outlook(reason),
        stamp_ns=estimate.end_ns,
        health=health,
        dominant_fault=health.dominant_fault,
        departure=estimate.departure,
    )
