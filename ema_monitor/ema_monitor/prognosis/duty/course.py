"""Duty of a unit from test to test: hours of growth at its tests, and duty to come by the past."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_monitor.prognosis.duty.damage import MEASURE, DamageSettings, damage_row
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
_STEPS: Final = 30


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
    reference: NDArray[np.float64] = field(init=False)
    relative: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        elapsed = np.diff(self.hours)
        reference, relative = np.full(2, np.nan), np.ones((3, elapsed.size))
        for number, rate in enumerate(self.rate if self.settings.growth_per == "damage" else ()):
            first = np.flatnonzero(np.isfinite(rate))[:REFERENCE_TESTS]
            if first.size < REFERENCE_TESTS or not np.any(rate[first] > 0.0):
                continue
            reference[number] = np.average(rate[first], weights=elapsed[first])
            own = np.minimum(rate / reference[number], _FASTEST)
            # An interval without known duty is as the one before; the first ones as the reference.
            latest = np.maximum.accumulate(np.where(np.isfinite(own), np.arange(own.size), -1))
            relative[number] = np.where(latest < 0, 1.0, own[latest])
        object.__setattr__(self, "reference", reference)
        object.__setattr__(self, "relative", relative)

    @property
    def is_known(self) -> bool:
        """Whether any growth is counted by damage."""
        return bool(np.isfinite(self.reference).any())

    @property
    def own_hours(self) -> NDArray[np.float64]:
        """Hours of growth of each component at the tests [h], ``(n, 7)``."""
        grown = np.cumsum(self.relative * np.diff(self.hours), axis=1)
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
        elapsed = np.diff(self.hours)[since:]
        return np.average(self.relative[:, since:], axis=1, weights=elapsed)[MEASURE]

    def lately(self, figure: NDArray[np.float64]) -> float:
        """Return the mean of a figure of the intervals since the latest change; NaN without any."""
        recent, elapsed = figure[self._since :], np.diff(self.hours)[self._since :]
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
        since = self._since
        words = f"future duty as flown since {self.hours[since]:.6g} h"
        rng = np.random.default_rng([1, self.hours.size])
        steps = self._drawn_since(since, rng)
        if (changes := self._changes.size) > 1:
            words += f", and changing as often as it did ({changes} times)"
            lasting = rng.exponential(self.hours[-1] - self.hours[0], size=(_PATHS, 1))
            lasting /= changes - 1
            steps = np.where(np.cumsum(steps[0], axis=1) <= lasting, steps, 0.0)
            # Where the steps do not last as long, the duty goes on as in their mean.
            drawn = steps.sum(axis=2, keepdims=True)
            mean = drawn / np.maximum(drawn[0], 1e-12)
            left = np.where(steps[0, :, -1:] > 0.0, lasting - drawn[0], 0.0) * mean
            steps = np.concatenate([steps, left, self._drawn_since(0, rng)], axis=2)
        return FutureDuty(factor, steps[0], steps[1:][MEASURE], words)

    def _drawn_since(self, since: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return hours of service, and of growth by measure, of steps, ``(4, p, s)`` [h]."""
        known = since + np.flatnonzero(np.diff(self.hours)[since:] > 0.0)
        # Whole stretches of the past: what follows one another is alike.
        length = max(round(np.sqrt(known.size)), 1)
        elapsed = np.diff(self.hours)[known]
        growth = self.relative[:, known] * elapsed
        start = rng.integers(known.size - length + 1, size=(_PATHS, _STEPS))
        passed = np.cumsum(np.concatenate([elapsed[None], growth]), axis=1)
        passed = np.concatenate([np.zeros((4, 1)), passed], axis=1)
        return passed[:, start + length] - passed[:, start]


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
    """Damage in the tests of a unit, from which its course follows for those that are used."""

    def __init__(self, settings: DamageSettings) -> None:
        self._settings = settings
        self._stamps_ns: list[int] = []
        self._passed: list[NDArray[np.float64]] = []
        self._latest = np.zeros(5)

    def add(self, entry: Entry) -> None:
        """Add the next test."""
        self._latest = self._latest + damage_row(entry.flown, self._settings)
        self._stamps_ns.append(entry.stamp_ns)
        self._passed.append(self._latest)

    def course(self, used: Sequence[TimedTest]) -> DutyCourse | None:
        """Return the duty between tests in the order of their hours; None without any known."""
        if len(used) <= REFERENCE_TESTS or not self._latest[0]:
            return None
        hours = np.array([test.hours for test in used])
        places = _places(np.array(self._stamps_ns), np.array([test.stamp_ns for test in used]))
        telemetry, travel, wear, warm, ageing = np.diff(np.array(self._passed)[places], axis=0).T
        elapsed = np.diff(hours)
        least = np.maximum(self._settings.least_coverage * elapsed, 1e-12)
        least = np.where(elapsed > 0.0, least, np.inf)
        # Beyond the hours in service the unit moved on the ground; what is not covered was alike.
        within = np.minimum(np.where(telemetry >= least, telemetry, np.nan), elapsed)
        known = np.where(warm >= least, warm, np.nan)
        rate = np.stack([wear / within, ageing / known])
        course = DutyCourse(self._settings, hours, rate, travel / within)
        return course if course.is_known else None


def _places(stamps_ns: NDArray[np.int64], wanted_ns: NDArray[np.int64]) -> NDArray[np.intp]:
    """Return where each wanted stamp is, the last place of one that is there twice."""
    order = np.argsort(stamps_ns, kind="stable")
    return order[np.searchsorted(stamps_ns, wanted_ns, side="right", sorter=order) - 1]
