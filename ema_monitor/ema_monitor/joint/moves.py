# SPDX-License-Identifier: Apache-2.0
"""Level and remaining life from figures of whole moves, for drives that log no samples.

The method is described in ``docs/real-data.md``, M48.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.special import stdtr
from scipy.stats import multivariate_t

from ema_core.arrays import Array
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.moves import Move
from ema_monitor.joint.departure import FEWEST, DatedFigures, Departure, JudgedFigure, departure_of
from ema_monitor.joint.record import NS_A_DAY

INDEX: Final = "all figures together"
"""Name of the mean logarithm of all figures."""

_BETWEEN_DAYS: Final = 0.02
_SIGNIFICANCE: Final = 1e-2
_LATEST: Final = 5
_RISING: Final = 0.05
_LEAST_SIGMA: Final = 0.03
_LEAST_RISE: Final = 0.03
_DRAWS: Final = 4000
_QUANTILES: Final = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class MoveVerdict:
    """Verdict on a move."""

    ratio: float
    """Geometric mean of the ratios of the figures to their healthy values [-]."""
    level: int
    """OK, WARN if the move departs, ERROR if the ratio reaches the limit, or STALE for a reference
    move."""
    departure: Departure | None = None
    """Departure from the reference moves; None for a reference move."""
    life_days: tuple[float, float, float] | None = None
    """5, 50 and 95 % quantiles of the time to the limit [d]; None without a prediction."""
    missing: int = 0
    """Number of further reference moves that are needed; 0 after the last of them."""

    @property
    def probability(self) -> float:
        """Probability that a healthy unit departs at least as much; 1 for a reference move."""
        return self.departure.probability if self.departure else 1.0


class MoveSeries:
    """Evaluates the moves of a unit in chronological order, without identifying faults.

    Parameters
    ----------
    limit
        Ratio to the healthy figures at which the unit must be removed, above 1.
    reference
        Number of initial moves that are assumed healthy; at least ``FEWEST``.

    Raises
    ------
    ValueError
        If a parameter is out of range.
    """

    def __init__(self, *, limit: float, reference: int) -> None:
        if not limit > 1.0:
            raise ValueError(f"limit = {limit:g}: expected a ratio above 1")
        if reference < FEWEST:
            raise ValueError(f"reference = {reference}: expected {FEWEST} or more moves")
        self._limit = limit
        self._reference = reference
        self._healthy: list[DatedFigures] = []
        self._course: list[tuple[float, float]] = []

    def add(self, move: Move) -> MoveVerdict:
        """Return the verdict on the next move, based on all earlier moves.

        Raises
        ------
        ValueError
            If the move is older than the previous move, a figure is not positive, or the move
            shares no figure with the reference.
        """
        day = move.stamp_ns / NS_A_DAY
        if self._course and day < self._course[-1][0]:
            raise ValueError(
                f"the move at {move.stamp_ns} ns is earlier than the previous move: "
                "sort the moves by time"
            )
        for name, value in move.figures.items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} = {value}: expected a positive number")
        logs = {name: math.log(value) for name, value in move.figures.items()}
        if len(self._healthy) < self._reference:
            self._healthy.append(DatedFigures(move.stamp_ns // NS_A_DAY, logs))
            missing = self._reference - len(self._healthy)
            self._course.append((day, 1.0))
            return MoveVerdict(1.0, STALE, missing=missing)
        names = [name for name in logs if all(name in move.values for move in self._healthy)]
        if not names:
            raise ValueError("the move shares no figure with the reference moves")
        healthy = {
            name: float(np.mean([move.values[name] for move in self._healthy])) for name in names
        }
        ratio = math.exp(float(np.mean([logs[name] - healthy[name] for name in names])))
        self._course.append((day, ratio))
        tested, *tests = (
            DatedFigures(day, _with_index(values, names))
            for day, values in ((move.stamp_ns // NS_A_DAY, logs), *self._healthy)
        )
        figures = {name: JudgedFigure(_BETWEEN_DAYS) for name in (*names, INDEX)}
        departure = departure_of(tested, tests, figures, _SIGNIFICANCE)
        if ratio >= self._limit:
            return MoveVerdict(ratio, ERROR, departure)
        level = WARN if departure.is_significant else OK
        life = self._life() if departure.is_significant else None
        return MoveVerdict(ratio, level, departure, life)

    def _life(self) -> tuple[float, float, float] | None:
        """Return quantiles of the time to the limit [d], or None without a significant rise.

        Random rising regression lines through the latest moves are extrapolated to the limit. Two
        sets of lines are pooled: in one, the ratio rises linearly; in the other, its distance from
        healthy grows exponentially. The second set needs three moves with a ratio above 1.03.
        """
        days, ratios = np.array(self._course[-_LATEST:]).T
        days = days - days[-1]
        not_rising, line = _crossings(days, ratios, self._limit, _LEAST_SIGMA)
        if not_rising > _RISING:
            return None
        rise = ratios - 1.0
        grown = rise > _LEAST_RISE
        limit, sigma = math.log(self._limit - 1.0), _LEAST_SIGMA / float(rise[-1])
        _, growth = _crossings(days[grown], np.log(rise[grown]), limit, sigma)
        low, middle, high = np.quantile(np.concatenate([line, growth]), _QUANTILES)
        return float(low), float(middle), float(high)


def _crossings(days: Array, values: Array, limit: float, least_sigma: float) -> tuple[float, Array]:
    """Return the probability that a regression line does not rise, and random times to a limit [d].

    The times are drawn from the distribution of the rising lines. With fewer than three points, or
    if all points have the same time, the probability is 1 and there are no times.
    """
    freedom = len(days) - 2
    if freedom < 1 or not np.ptp(days) > 0.0:
        return 1.0, np.empty(0)
    line, shape = np.polyfit(days, values, 1, cov="unscaled")
    variance = float(np.sum((values - np.polyval(line, days)) ** 2)) / freedom
    shape *= max(variance, least_sigma**2)
    distribution: Any = line, shape, freedom
    draws = multivariate_t.rvs(*distribution, size=_DRAWS, random_state=0)
    slope, level = draws[draws[:, 0] > 0.0].T
    not_rising = float(stdtr(freedom, -line[0] / math.sqrt(shape[0, 0])))
    return not_rising, np.maximum((limit - level) / slope, 0.0)


def _with_index(figures: Mapping[str, float], names: list[str]) -> dict[str, float]:
    chosen = {name: figures[name] for name in names}
    return {**chosen, INDEX: float(np.mean(list(chosen.values())))}
