"""Interface of the laws of growth: their curves, how a level moves, and when it passes a limit."""

import math
from collections.abc import Callable
from typing import ClassVar, Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_core.growth_laws import TIME_SCALE_LAWS, hours_until, increment

BENDS: Final = tuple(np.geomspace(1.15, 6.0, 12).tolist())
"""Bends of curves of unknown law [-].

The weakest bend hardly differs from a line. With the strongest bends, half of the growth happens in
the last fifth to tenth of life. Neighbours are so close that predictions do not depend on where
between them the real bend lies.
"""


class Curve(NamedTuple):
    """A curve of a law."""

    shape: float = 0.0  # second figure of the law [-]
    share: float = 1.0  # of the prior, relative to other curves [-]
    third: float = 0.0  # of drift its s [1/sqrt(h)], of jumps their mean size, of logistic x_0 [-]


class Figures(NamedTuple):
    """Figures of cells or samples that follow a law, ``(n,)`` each."""

    side: Array  # of healthy, on which it grows, -1 or 1
    rate: Array  # of the law [1/h], or its time scale [h]
    shape: Array
    third: Array  # as in `Curve`
    limit: Array  # distance from healthy at which life ends [-]


class Levels(NamedTuple):
    """Probability, mean and variance of the levels of cells, ``(n,)`` each, changed in place."""

    weight: Array  # probabilities of the cells [-]
    mean: Array  # of the signed distance from healthy [-]
    variance: Array


class Future(NamedTuple):
    """Future times of growth of samples, ``(m, n)`` each."""

    hours: Array  # of growth from now on, ascending [h]
    paced: Array  # the same at a pace that may wander [h]
    noise: Array  # contribution of process noise [h]
    wiener: Array  # standard Wiener process [sqrt(h)]

    def time(self, hours: Array) -> Array:
        """Return hours of growth with process noise, limited to be ascending [h]."""
        return np.maximum.accumulate(np.maximum(hours + self.noise, 0.0), axis=0)


class Law:
    """A law that grows by an exact solution of ``ema_core.growth_laws``, with process noise."""

    name: ClassVar[str]
    """Name of the law."""
    solution: ClassVar[str] = ""
    """Name of the exact solution; empty if it is the name of the law."""
    is_random: ClassVar[bool] = False
    """Whether growth itself is random, so that steps and changes of rate are part of it."""
    copies: ClassVar[int] = 1
    """Number of cells for each rate."""
    either_side: ClassVar[bool] = False
    """Whether the law is only for faults that can leave their healthy value to either side."""

    @property
    def has_time_scale(self) -> bool:
        """Whether the rate of the law is a time scale [h], not a speed [1/h]."""
        return (self.solution or self.name) in TIME_SCALE_LAWS

    def curves(self, limit: float) -> list[Curve]:
        """Return the curves that a fault of unknown law may follow to a limit [-].

        A law without curves is only used for faults whose law is known.
        """
        return []

    def wandering(self, limit: float) -> list[float]:
        """Return the shapes of the curves with a wandering rate, for a limit [-]."""
        return []

    def increment(self, x: Array, of: Figures, hours: Array) -> Array:
        """Return the growth over some hours from distances ``x``, without noise [-]."""
        return increment(self.solution or self.name, x, of.rate, of.shape, hours)

    def hours_until(self, x: Array, of: Figures) -> Array:
        """Return the hours of growth from distances ``x`` to the limit, without noise [h]."""
        return hours_until(self.solution or self.name, x, of.rate, of.shape, of.limit)

    def advance(self, levels: Levels, of: Figures, hours: Array, noise_hours: float) -> None:
        """Advance the levels in place.

        Parameters
        ----------
        levels, of
            Levels of the cells, and their figures.
        hours
            Hours of growth of each cell, ``(n,)`` [h].
        noise_hours
            Variance of the effective time of growth per hour [h].
        """
        sd = np.sqrt(levels.variance)
        x = np.maximum(of.side * levels.mean + np.stack([-sd, sd]), 0.0)
        step = np.minimum(self.increment(x, of, hours), 1.0)
        spread = 0.5 * np.diff(x + step, axis=0)[0]
        noise = np.mean(step, axis=0) ** 2 * noise_hours / np.where(hours, hours, 1.0)
        grown = hours > 0.0
        levels.mean[:] = np.where(grown, of.side * np.mean(x + step, axis=0), levels.mean)
        levels.variance[:] = np.where(grown, spread**2 + noise, levels.variance)

    def passage(
        self, x: Array, of: Figures, noise_hours: float, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Return mean and shape of the inverse Gaussian hours to the limit, ``(n,)`` each [h].

        With a shape of 0 the hours are the mean.
        """
        hours = self.hours_until(np.maximum(x, 0.0), of)
        return hours, hours**2 / max(noise_hours, 1e-12)

    def future(self, x: Array, of: Figures, ahead: Future, rng: np.random.Generator) -> Array:
        """Return distances from healthy in the future, ``(m, n)`` [-]."""
        x = np.maximum(x, 0.0)
        return x + self.increment(x, of, ahead.time(ahead.paced))


def bent(bend_of: Callable[[float], float], bend: float) -> float:
    """Return the argument at which an ascending function reaches a bend, by bisection."""
    low, high = 1e-3, 500.0
    while high > low * (1.0 + 1e-12):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if bend_of(middle) < bend else (low, middle)
    return low
