"""Figures of whole moves, where a drive logs no samples: level, and the life to a limit (M48)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from ema_core.arrays import Array
from ema_monitor.normal.features import FIGURE, Feature
from ema_monitor.normal.normal import FEWEST_TESTS, Departure, HealthyTest, Normal

INDEX: Final = "all figures together"
"""Name of the mean of all figures, by their logarithm."""

_NS_A_DAY: Final = 86_400e9
_LATEST: Final = 5
_RISING: Final = 0.05
_LEAST_SIGMA: Final = 0.03
_LEAST_RISE: Final = 0.03
_DRAWS: Final = 4000
_QUANTILES: Final = (0.05, 0.5, 0.95)


class Move(NamedTuple):
    """Figures of one move, or the means of several alike, by name; all are positive."""

    stamp_ns: int
    figures: Mapping[str, float]


@dataclass(frozen=True)
class MoveVerdict:
    """Verdict on a move.

    Attributes
    ----------
    ratio
        Its figures over the healthy ones, geometric mean [-].
    level
        OK, WARN where it departs, ERROR where the limit is passed, STALE while nothing is known.
    departure
        How unlikely it is for the healthy unit; None while the reference is not complete.
    life_days
        Quantiles of 5, 50 and 95 % of the time to the limit [d]; None where none is predicted.
    """

    ratio: float
    level: str
    departure: Departure | None
    life_days: tuple[float, float, float] | None
    reason: str

    @property
    def probability(self) -> float:
        """Probability of so large a departure of a healthy unit."""
        return self.departure.probability if self.departure else 1.0


class MoveSeries:
    """Follows the moves of a unit, one after the other; no fault is claimed.

    Parameters
    ----------
    limit
        Ratio to the healthy figures at which the unit has to be removed, above 1.
    reference
        How many of the first moves are taken for healthy, ``FEWEST_TESTS`` at least.

    Raises
    ------
    ValueError
        When a figure is impossible.
    """

    def __init__(self, *, limit: float, reference: int) -> None:
        if not limit > 1.0:
            raise ValueError(f"limit = {limit:g}: expected a ratio above 1")
        if reference < FEWEST_TESTS:
            raise ValueError(f"reference = {reference}: expected {FEWEST_TESTS} or more moves")
        self._limit = limit
        self._reference = reference
        self._healthy: list[HealthyTest] = []
        self._days: list[float] = []
        self._ratios: list[float] = []

    def add(self, move: Move) -> MoveVerdict:
        """Return what is told of the next move by those before it.

        Raises
        ------
        ValueError
            When it is earlier than the one before, or a figure is not positive.
        """
        day = move.stamp_ns / _NS_A_DAY
        if self._days and day < self._days[-1]:
            raise ValueError(
                f"the move at {move.stamp_ns} ns is earlier than the one before: sort them by time"
            )
        for name, value in move.figures.items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} = {value}: expected a positive number")
        logs = {name: math.log(value) for name, value in move.figures.items()}
        if len(self._healthy) < self._reference:
            self._healthy.append(HealthyTest(move.stamp_ns, logs))
            missing = self._reference - len(self._healthy)
            self._note(day, 1.0)
            reason = f"reference; {missing} more needed" if missing else "reference"
            return MoveVerdict(1.0, "STALE", None, None, reason)
        names = [name for name in logs if all(name in one.features for one in self._healthy)]
        if not names:
            raise ValueError("the move has none of the figures of the reference")
        healthy = {
            name: float(np.mean([one.features[name] for one in self._healthy])) for name in names
        }
        ratio = math.exp(float(np.mean([logs[name] - healthy[name] for name in names])))
        self._note(day, ratio)
        tests = [
            HealthyTest(one.stamp_ns, _with_index(one.features, names)) for one in self._healthy
        ]
        known = {name: Feature(FIGURE, name) for name in (*names, INDEX)}
        departure = Normal(tests, known).departure(
            HealthyTest(move.stamp_ns, _with_index(logs, names))
        )
        if ratio >= self._limit:
            reason = f"{ratio:.2f} times healthy: the limit of {self._limit:g} is passed"
            return MoveVerdict(ratio, "ERROR", departure, None, reason)
        level = "WARN" if departure.is_significant else "OK"
        life = self._life() if departure.is_significant else None
        reason = str(departure.changes[0]) if departure.changes else str(departure)
        return MoveVerdict(ratio, level, departure, life, reason)

    def _note(self, day: float, ratio: float) -> None:
        self._days.append(day)
        self._ratios.append(ratio)

    def _life(self) -> tuple[float, float, float] | None:
        """Return the quantiles of the time to the limit; None where nothing rises for certain.

        The latest moves rise by a straight line, or their distance from healthy grows by a constant
        factor: both are open as long as the limit is far, and count alike.
        """
        first = max(0, len(self._days) - _LATEST)
        days = np.array(self._days[first:]) - self._days[-1]
        ratios = np.array(self._ratios[first:])
        line = _Line.of(days, ratios, _LEAST_SIGMA)
        if line is None or line.falling > _RISING:
            return None
        times = [line.crossing(self._limit)]
        rise = ratios - 1.0
        grown = rise > _LEAST_RISE
        growth = _Line.of(days[grown], np.log(rise[grown]), _LEAST_SIGMA / float(rise[-1]))
        if growth is not None:
            times.append(growth.crossing(math.log(self._limit - 1.0)))
        low, middle, high = np.quantile(np.concatenate(times), _QUANTILES)
        return float(low), float(middle), float(high)


class _Line(NamedTuple):
    """A regression line over the days until now, its covariance and degrees of freedom."""

    values: NDArray[Any]
    covariance: NDArray[Any]
    freedom: int

    @classmethod
    def of(cls, days: Array, values: Array, least_sigma: float) -> "_Line | None":
        """Return the line through at least three points; None where there is none."""
        if len(days) < 3 or not np.ptp(days) > 0.0:
            return None
        design = np.stack([np.ones(len(days)), days], axis=1)
        found, *_ = np.linalg.lstsq(design, values, rcond=None)
        freedom = len(days) - 2
        variance = float(np.sum((values - design @ found) ** 2)) / freedom
        covariance = np.linalg.inv(design.T @ design) * max(variance, least_sigma**2)
        return cls(found, covariance, freedom)

    @property
    def falling(self) -> float:
        """Probability that the line does not rise."""
        return float(stdtr(self.freedom, -self.values[1] / math.sqrt(self.covariance[1, 1])))

    def crossing(self, limit: float) -> Array:
        """Return times to a limit, drawn from what is known of the line, as far as it rises [d]."""
        rng = np.random.default_rng(0)
        shape = np.linalg.cholesky(self.covariance)
        normal = rng.standard_normal((_DRAWS, 2)) @ shape.T
        wide = np.sqrt(self.freedom / rng.chisquare(self.freedom, (_DRAWS, 1)))
        level, slope = (self.values + normal * wide).T
        rises = slope > 0.0
        return np.maximum((limit - level[rises]) / slope[rises], 0.0)


def _with_index(figures: Mapping[str, float], names: list[str]) -> dict[str, float]:
    chosen = {name: figures[name] for name in names}
    return {**chosen, INDEX: float(np.mean(list(chosen.values())))}
