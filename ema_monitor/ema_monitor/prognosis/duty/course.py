"""Duty of a unit from test to test: hours of growth at its tests, and duty to come by the past."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_monitor.prognosis.duty.damage import MEASURE, DamageSettings
from ema_monitor.prognosis.duty.future import FutureDuty
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.service import TimedTest

REFERENCE_TESTS: Final = 10
"""Intervals of known duty whose mean is the reference; with fewer, growth is by hours."""

_FASTEST: Final = 1e3
_LEAST_SINCE: Final = 2
_LEAST_SPREAD: Final = 0.03
_MOST_CUT: Final = 1000
_SIGMA_OF_MEDIAN: Final = 1.4826 / np.sqrt(2.0)
"""Standard deviation over the median magnitude of differences, of independent normal values."""
_PATHS: Final = 100


@dataclass(frozen=True, eq=False)
class DutyCourse:
    """Duty of a unit in the intervals between its tests.

    Attributes
    ----------
    settings
        How duty does damage.
    hours
        Service hours of the tests [h], ``(n,)``.
    rate
        Wear [rad/h] and ageing [-] in an hour of each interval, ``(2, n - 1)``; NaN where not
        known.
    travel
        Travel of the user shaft in an hour of each [rad/h], ``(n - 1,)``; NaN where not known.
    reference
        Wear and ageing in an hour at the reference duty, ``(2,)``; NaN where there is none.
    relative
        Hours of growth in an hour of each interval, by wear, ageing and hours, ``(3, n - 1)``.
    """

    settings: DamageSettings
    hours: NDArray[np.float64]
    rate: NDArray[np.float64]
    travel: NDArray[np.float64]
    reference: NDArray[np.float64] = field(default_factory=lambda: np.full(2, np.nan))
    relative: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "relative", np.ones((3, self.travel.size)))
        for number, rate in enumerate(self.rate if self.settings.growth_per == "damage" else ()):
            first = np.flatnonzero(np.isfinite(rate))[:REFERENCE_TESTS]
            if first.size < REFERENCE_TESTS or not np.any(rate[first] > 0.0):
                continue
            self.reference[number] = np.average(rate[first], weights=self.elapsed[first])
            own = np.minimum(rate / self.reference[number], _FASTEST)
            # An interval without known duty is as the one before; the first ones as the reference.
            latest = np.maximum.accumulate(np.where(np.isfinite(own), np.arange(own.size), -1))
            self.relative[number] = np.where(latest < 0, 1.0, own[latest])

    @property
    def elapsed(self) -> NDArray[np.float64]:
        """Service hours of the intervals [h], ``(n - 1,)``."""
        return np.diff(self.hours)

    @property
    def is_known(self) -> bool:
        """Whether any growth is counted by damage."""
        return bool(np.isfinite(self.reference).any())

    @property
    def own_hours(self) -> NDArray[np.float64]:
        """Hours of growth of each component at the tests [h], ``(n, 7)``."""
        grown = np.cumsum(self.relative * self.elapsed, axis=1)
        own = np.concatenate([np.zeros((3, 1)), grown], axis=1) + self.hours[0]
        own[~np.append(np.isfinite(self.reference), False)] = self.hours
        return own[MEASURE].T

    @cached_property
    def _changes(self) -> NDArray[np.intp]:
        """Numbers of the first intervals after changes, of the measure with the latest one."""
        known = np.isfinite(self.reference)
        found = [duty_changes(one) for one in self.relative[:2][known]]
        return max(found, key=lambda one: (one[-1:].sum(), one.size), default=np.empty(0, np.intp))

    @property
    def _since(self) -> int:
        """Number of the first interval since the latest change of the duty."""
        return int(self._changes[-1:].sum())

    @property
    def present(self) -> NDArray[np.float64]:
        """Hours of growth of each component in an hour since the latest change, ``(7,)`` [-]."""
        since = self._since
        return np.average(self.relative[:, since:], axis=1, weights=self.elapsed[since:])[MEASURE]

    def lately(self, figure: NDArray[np.float64]) -> float:
        """Return the mean of a figure of the intervals since the latest change; NaN without any."""
        recent, elapsed = figure[self._since :], self.elapsed[self._since :]
        known = np.isfinite(recent)
        return float(np.average(recent[known], weights=elapsed[known])) if known.any() else np.nan

    def as_flown(self, factor: float) -> FutureDuty:
        """Return the duty to come, drawn from that flown (P24).

        Each path begins as since the latest change. Where there were k > 1 changes in T hours, it
        goes on as in all of the past after a time that is exponentially distributed with the mean
        T / (k - 1): one change may last.

        Parameters
        ----------
        factor
            Growth beside it [-].
        """
        rng = np.random.default_rng([1, self.hours.size])
        present, later = self._drawn_since(self._since, rng), self._drawn_since(0, rng)
        words = f"future duty as flown since {self.hours[self._since]:.6g} h"
        lasting = np.full(_PATHS, np.inf)
        if (changes := self._changes.size) > 1:
            words += f", and changing as often as it did ({changes} times)"
            mean = (self.hours[-1] - self.hours[0]) / (changes - 1)
            lasting = rng.exponential(mean, size=_PATHS)
        return FutureDuty(factor, present, later, lasting, words)

    def _drawn_since(self, since: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return mean hours of growth in an hour of each path, ``(7, p)``: a block bootstrap."""
        known = since + np.flatnonzero(self.elapsed[since:] > 0.0)
        # Whole stretches of the past: what follows one another is alike.
        length = max(round(np.sqrt(known.size)), 1)
        start = rng.integers(known.size - length + 1, size=(_PATHS, -(-known.size // length)))
        drawn = known[start[..., None] + np.arange(length)].reshape(_PATHS, -1)
        elapsed = self.elapsed[drawn]
        growth = np.sum(self.relative[:, drawn] * elapsed, axis=-1)
        return (growth / elapsed.sum(axis=-1))[MEASURE]


def duty_changes(relative: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the numbers of the first intervals after changes of a duty, in their order.

    The logarithm of the duty is cut into parts of the least sum of squares about their means, in
    units of its scatter from one interval to the next, and 4 ln n for each of its n intervals'
    cuts (optimal partitioning, Jackson et al. 2005). A part has two intervals at least.

    Parameters
    ----------
    relative
        Duty of the intervals, ``(n,)`` [-]; the latest thousand are looked at.
    """
    before = max(relative.size - _MOST_CUT, 0)
    value = np.log(np.maximum(relative[before:], 1.0 / _FASTEST))
    size = value.size
    if size < 2 * _LEAST_SINCE:
        return np.empty(0, np.intp)
    scatter = np.median(np.abs(np.diff(value))) * _SIGMA_OF_MEDIAN
    value /= max(float(scatter), _LEAST_SPREAD)
    sums, squares = (np.concatenate([[0.0], np.cumsum(one)]) for one in (value, value**2))
    cost, cut = np.full(size + 1, np.inf), np.zeros(size + 1, np.intp)
    cost[0] = 0.0
    for end in range(_LEAST_SINCE, size + 1):
        first = np.arange(end - _LEAST_SINCE + 1)
        within = squares[end] - squares[first] - (sums[end] - sums[first]) ** 2 / (end - first)
        total = cost[first] + within
        cut[end] = np.argmin(total)
        cost[end] = total[cut[end]] + 4.0 * np.log(size)
    found, end = [], cut[size]
    while end:
        found.append(before + end)
        end = cut[end]
    return np.array(found[::-1], np.intp)


class DutyRecord:
    """Damage up to the tests of a unit, from which its course follows for those that are used."""

    def __init__(self, settings: DamageSettings) -> None:
        self._settings = settings
        self._total = np.zeros(5)
        # By the stamp of the test [ns].
        self._until: dict[int, NDArray[np.float64]] = {}

    def add(self, entry: Entry) -> None:
        """Add the next test."""
        self._total = self._total + self._settings.damage(entry.flown)
        self._until[entry.stamp_ns] = self._total

    def course(self, used: Sequence[TimedTest]) -> DutyCourse | None:
        """Return the duty between tests in the order of their hours; None without any known."""
        if len(used) <= REFERENCE_TESTS or not self._total[0]:
            return None
        hours = np.array([test.hours for test in used])
        until = np.array([self._until[test.stamp_ns] for test in used])
        telemetry, travel, wear, warm, ageing = np.diff(until, axis=0).T
        elapsed = np.diff(hours)
        least = np.maximum(self._settings.least_coverage * elapsed, 1e-12)
        least = np.where(elapsed > 0.0, least, np.inf)
        # Beyond the hours in service the unit moved on the ground; what is not covered was alike.
        within = np.minimum(np.where(telemetry >= least, telemetry, np.nan), elapsed)
        rate = np.stack([wear / within, ageing / np.where(warm >= least, warm, np.nan)])
        course = DutyCourse(self._settings, hours, rate, travel / within)
        return course if course.is_known else None
