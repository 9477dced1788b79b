# SPDX-License-Identifier: Apache-2.0
"""Duty of a unit between its tests, and extrapolation to future duty."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array
from ema_core.faults import COMPONENTS
from ema_core.quantity import is_finite_number
from ema_monitor.prognosis.duty.damage import MEASURE, DamageSettings

REFERENCE_TESTS: Final = 10
"""Number of intervals of known duty whose mean is the reference; with fewer intervals, growth is
counted in service hours."""

AS_BEFORE: Final = "future use as in the past"

_FASTEST: Final = 1e3
_LEAST_SINCE: Final = 2
_LEAST_SPREAD: Final = 0.03
_MOST_CUT: Final = 1000
_SIGMA_OF_MEDIAN: Final = 1.4826 / np.sqrt(2.0)
"""Ratio of the standard deviation to the median magnitude of differences, for independent normal
values [-]."""
_PATHS: Final = 100
_BY_HOURS: Final = np.ones((len(COMPONENTS), 1))


@dataclass(frozen=True, eq=False)
class FutureDuty:
    """Growth hours per future service hour; by default, usage continues as in the past.

    A growth hour is the time at the reference duty that causes the same damage (P23).

    Raises
    ------
    ValueError
        If the factor is not a number above 0.
    """

    factor: float = 1.0
    """Factor of growth in addition to the paths [-]."""
    present: Array = field(default_factory=lambda: _BY_HOURS)
    later: Array = field(default_factory=lambda: _BY_HOURS)
    """Growth hours of each component per service hour, during the present duty and after its end,
    on one or several paths, ``(7, p)`` each [-]."""
    lasting: Array = field(default_factory=lambda: np.full(1, np.inf))
    """Service hours for which the present duty lasts on each path, ``(p,)`` [h]."""
    since_hours: float = np.nan
    """Service hour from which the flown duty is repeated [h]; NaN if unknown."""
    changes: int = 0
    """Number of duty changes so far, which are expected at the same rate in future; 0 for fewer
    than two."""
    planned: Mapping[str, object] = field(default_factory=dict)
    """Values of a scenario that replace flown values, by name."""

    def __post_init__(self) -> None:
        if not (is_finite_number(self.factor) and self.factor > 0.0):
            raise ValueError(f"duty = {self.factor!r}: expected a number above 0")

    def __str__(self) -> str:
        is_flown = np.isfinite(self.since_hours)
        text = f"future duty {self._as_flown}" if is_flown else AS_BEFORE
        if self.planned:
            plan = ", ".join(f"{name} = {value}" for name, value in self.planned.items())
            text = f"future duty: {plan}, the rest {self._as_flown}"
        if self.factor == 1.0:
            return text
        duty = f"by {text}" if is_flown else "in the past"
        return f"faults grow {self.factor:g} times as fast in each future service hour as {duty}"

    @property
    def _as_flown(self) -> str:
        text = f"as flown since {self.since_hours:.6g} h"
        if self.changes:
            text += f", and changing as often as it did ({self.changes} times)"
        return text

    def hours_of(self, growth_hours: Array) -> Array:
        """Return growth hours converted to service hours, ``(7, n)`` [h].

        Parameters
        ----------
        growth_hours
            Growth hours [h], ``(7, n)``; each column is one path, common to all components.
        """
        path = np.arange(growth_hours.shape[1]) % self.lasting.size
        growth_hours, lasting = growth_hours / self.factor, self.lasting[path]
        with np.errstate(divide="ignore", invalid="ignore"):
            at_first = np.where(growth_hours > 0.0, growth_hours / self.present[:, path], 0.0)
            more = growth_hours - lasting * self.present[:, path]
            after = lasting + more / self.later[:, path]
        return np.where(at_first <= lasting, at_first, after)

    def own_hours(self, hours: Array, n: int) -> Array:
        """Return service hours converted to growth hours [h].

        Parameters
        ----------
        hours
            Ascending service hours from now [h], ``(m,)``.
        n
            Number of samples; the paths are assigned to them in turn.

        Returns
        -------
        numpy.ndarray
            Growth hours [h], in a shape that broadcasts to ``(m, 7, n)``.
        """
        path = np.arange(n) % self.lasting.size
        at_first = np.minimum(hours[:, None, None], self.lasting[path])
        after = hours[:, None, None] - at_first
        return self.factor * (at_first * self.present[:, path] + after * self.later[:, path])


STEADY: Final = FutureDuty()


class DutyCourse:
    """Duty of a unit in the intervals between its tests.

    Parameters
    ----------
    settings
        Settings that relate damage to duty.
    hours
        Service hours of the tests [h], ``(n,)``.
    hourly
        Wear [rad/h], ageing [-] and travel of the user shaft [rad/h] per service hour in each
        interval, ``(3, n - 1)``; NaN where unknown.

    Attributes
    ----------
    elapsed
        Service hours in each interval [h], ``(n - 1,)``.
    reference
        Wear and ageing per service hour at the reference duty, ``(2,)``; NaN without a reference.
    relative
        Growth hours per service hour in each interval, by wear, ageing and hours, ``(3, n - 1)``.
    changes
        Index of the first interval after each duty change, for the measure that changed last.
    """

    def __init__(self, settings: DamageSettings, hours: Array, hourly: Array) -> None:
        self.settings, self.hours, self.hourly = settings, hours, hourly
        self.elapsed = np.diff(hours)
        self.reference = np.full(2, np.nan)
        self.relative = np.ones(hourly.shape)
        changes = [np.empty(0, np.intp)]
        for number, rate in enumerate(hourly[:2] if settings.growth_per == "damage" else ()):
            first = np.flatnonzero(np.isfinite(rate))[:REFERENCE_TESTS]
            if first.size < REFERENCE_TESTS or not np.any(rate[first] > 0.0):
                continue
            self.reference[number] = np.average(rate[first], weights=self.elapsed[first])
            ratio = np.minimum(rate / self.reference[number], _FASTEST)
            # An interval of unknown duty repeats its predecessor, or the reference at the start.
            latest = np.maximum.accumulate(np.where(np.isfinite(ratio), np.arange(ratio.size), -1))
            self.relative[number] = np.where(latest < 0, 1.0, ratio[latest])
            changes.append(duty_changes(self.relative[number]))
        self.changes = max(changes, key=lambda firsts: (firsts[-1:].sum(), firsts.size))
        self.since = int(self.changes[-1:].sum())

    @property
    def own_hours(self) -> Array:
        """Growth hours of each component at the tests [h], ``(n, 7)``.

        Components without a reference duty have service hours.
        """
        grown = np.cumsum(self.relative * self.elapsed, axis=1)
        growth_hours = np.concatenate([np.zeros((3, 1)), grown], axis=1) + self.hours[0]
        growth_hours[~np.append(np.isfinite(self.reference), False)] = self.hours
        return growth_hours[MEASURE].T

    @property
    def present(self) -> Array:
        """Growth hours per service hour of each component since the latest change, ``(7,)`` [-]."""
        return self.lately(self.relative)[MEASURE]

    def lately(self, figures: Array) -> Array:
        """Return the mean of each row of ``figures`` since the latest duty change, ``(k,)``.

        ``figures``, ``(k, n - 1)``, has a value for each interval, weighted by its service hours.
        The mean is NaN if unknown.
        """
        recent = figures[:, self.since :]
        elapsed = np.where(np.isfinite(recent), self.elapsed[self.since :], 0.0)
        hours = np.sum(elapsed, axis=1)
        return np.nansum(recent * elapsed, axis=1) / np.where(hours > 0.0, hours, np.nan)

    def as_flown(self, factor: float) -> FutureDuty:
        """Return a future duty drawn from the flown duty (P24).

        Each path begins with the duty since the latest change. With k > 1 changes in T hours, it
        continues with the duty of the whole past after an exponentially distributed time with mean
        T / (k - 1). A single change may be permanent.

        Parameters
        ----------
        factor
            Factor of growth in addition to the duty [-].
        """
        rng = np.random.default_rng([1, self.hours.size])
        present, later = self._drawn_since(self.since, rng), self._drawn_since(0, rng)
        lasting = np.full(_PATHS, np.inf)
        if (changes := self.changes.size) > 1:
            mean = (self.hours[-1] - self.hours[0]) / (changes - 1)
            lasting = rng.exponential(mean, size=_PATHS)
        since_hours = float(self.hours[self.since])
        repeated = changes if changes > 1 else 0
        return FutureDuty(factor, present, later, lasting, since_hours, repeated)

    def _drawn_since(self, since: int, rng: np.random.Generator) -> Array:
        """Return mean growth hours per service hour of paths from a block bootstrap, ``(7, p)``.

        The intervals from index ``since`` on are drawn.
        """
        intervals = since + np.flatnonzero(self.elapsed[since:] > 0.0)
        # Successive intervals are correlated: draw blocks of them.
        n = intervals.size
        length = max(round(np.sqrt(n)), 1)
        start = rng.integers(n - length + 1, size=(_PATHS, -(-n // length)))
        drawn = intervals[start[..., None] + np.arange(length)].reshape(_PATHS, -1)
        elapsed = self.elapsed[drawn]
        growth = np.sum(self.relative[:, drawn] * elapsed, axis=-1)
        return (growth / elapsed.sum(axis=-1))[MEASURE]


def duty_changes(relative: Array) -> NDArray[np.intp]:
    """Return the index of the first interval after each detected change of duty.

    The logarithm of the duty of n intervals is divided into parts. Their sum of squares about their
    means, in units of the scatter from one interval to the next, plus 4 ln n for each cut is
    minimised (optimal partitioning, Jackson et al. 2005). A part has at least two intervals.

    Parameters
    ----------
    relative
        Duty of each interval, ``(n,)`` [-]; only the latest thousand intervals are searched.
    """
    before = max(relative.size - _MOST_CUT, 0)
    value = np.log(np.maximum(relative[before:], 1.0 / _FASTEST))
    size = value.size
    if size < 2 * _LEAST_SINCE:
        return np.empty(0, np.intp)
    scatter = np.median(np.abs(np.diff(value))) * _SIGMA_OF_MEDIAN
    value /= max(float(scatter), _LEAST_SPREAD)
    sums, squares = (np.concatenate([[0.0], np.cumsum(power)]) for power in (value, value**2))
    cost, cut = np.full(size + 1, np.inf), np.zeros(size + 1, np.intp)
    cost[0] = 0.0
    for end in range(_LEAST_SINCE, size + 1):
        first = np.arange(end - _LEAST_SINCE + 1)
        within = squares[end] - squares[first] - (sums[end] - sums[first]) ** 2 / (end - first)
        total = cost[first] + within
        cut[end] = np.argmin(total)
        cost[end] = total[cut[end]] + 4.0 * np.log(size)
    changes, end = [], cut[size]
    while end:
        changes.append(before + end)
        end = cut[end]
    return np.array(changes[::-1], np.intp)
