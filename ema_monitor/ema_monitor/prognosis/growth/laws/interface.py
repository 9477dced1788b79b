# SPDX-License-Identifier: Apache-2.0
"""Interface of growth laws: candidate curves, propagation of levels and first passage of limits."""

import math
from collections.abc import Callable
from typing import ClassVar, Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_core.growth_laws import TIME_SCALE_LAWS, hours_until, increment

BENDS: Final = tuple(np.geomspace(1.15, 6.0, 12).tolist())
"""Bends of the candidate curves of unknown laws: slope at the limit over mean slope [-].

The weakest bend is almost a straight line. With the strongest bends, half of the growth occurs in
the last tenth to fifth of life. The spacing is fine enough that predictions do not depend on where
the true bend lies between neighbours.
"""


class Curve(NamedTuple):
    """Candidate curve of a growth law."""

    shape: float = 0.0
    """Second parameter of the law [-]."""
    share: float = 1.0
    """Prior weight relative to other curves [-]."""
    third: float = 0.0
    """Third parameter: s of drift [1/sqrt(h)], mean jump size or logistic x_0 [-]."""


class Figures(NamedTuple):
    """Law parameters of cells or samples that follow the same law, ``(n,)`` each."""

    side: Array
    """Direction of growth from healthy, -1 or 1."""
    rate: Array
    """Rate [1/h]; for law ``power``, the time scale [h]."""
    shape: Array
    """Second parameter of the law."""
    third: Array
    """Third parameter of the law, see `Curve`."""
    limit: Array
    """Distance from healthy at which life ends [-]."""


class Levels(NamedTuple):
    """Gaussian filters of cells of the same law, ``(n,)`` each.

    `Law.advance` updates the arrays in place.

    Each cell is a hypothesis about shape and rate. Its filter estimates the level, which is the
    signed distance from healthy.
    """

    weight: Array
    """Probability that the hypothesis of the cell is true [-]."""
    mean: Array
    """Mean of the level [-]."""
    variance: Array
    """Variance of the level [-]."""


class Future(NamedTuple):
    """Future growth times of samples, ``(m, n)`` each."""

    hours: Array
    """Growth hours from now, ascending [h]."""
    paced: Array
    """Growth hours at a possibly wandering pace [h]."""
    noise: Array
    """Process noise of the growth time [h]."""
    wiener: Array
    """Standard Wiener process [sqrt(h)]."""

    def time(self, hours: Array) -> Array:
        """Return growth hours with process noise, made non-decreasing [h]."""
        return np.maximum.accumulate(np.maximum(hours + self.noise, 0.0), axis=0)


class Law:
    """Base class: growth by an exact solution in ``ema_core.growth_laws``, with process noise."""

    name: ClassVar[str]
    """Name of the law."""
    solution: ClassVar[str] = ""
    """Name of the exact solution in ``ema_core.growth_laws``; empty if equal to ``name``."""
    is_random: ClassVar[bool] = False
    """Whether growth is random by nature, so that it includes steps and rate changes."""
    copies: ClassVar[int] = 1
    """Number of cells for each rate."""
    either_side: ClassVar[bool] = False
    """Whether the law only applies to faults that can deviate to either side of healthy."""

    @property
    def has_time_scale(self) -> bool:
        """Whether the rate of the law is a time scale [h], not a speed [1/h]."""
        return (self.solution or self.name) in TIME_SCALE_LAWS

    def curves(self, limit: float) -> list[Curve]:
        """Return the candidate curves for a fault of unknown law, given its limit [-]."""
        return []

    def wandering(self, limit: float) -> list[float]:
        """Return the shapes of candidate curves with a wandering rate, given the limit [-]."""
        return []

    def increment(self, x: Array, of: Figures, hours: Array) -> Array:
        """Return the noise-free growth from distances ``x`` over the given hours [-]."""
        return increment(self.solution or self.name, x, of.rate, of.shape, hours)

    def hours_until(self, x: Array, of: Figures) -> Array:
        """Return the noise-free growth time from distances ``x`` to the limit [h]."""
        return hours_until(self.solution or self.name, x, of.rate, of.shape, of.limit)

    def advance(self, levels: Levels, of: Figures, hours: Array, noise_hours: float) -> None:
        """Propagate the levels in place.

        Parameters
        ----------
        levels, of
            Levels and law parameters of the cells.
        hours
            Growth hours of each cell, ``(n,)`` [h].
        noise_hours
            Variance of the effective growth time per hour [h].
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
        """Return mean and shape of the inverse Gaussian first-passage time, ``(n,)`` each [h].

        A shape of 0 means that the time equals the mean.
        """
        hours = self.hours_until(np.maximum(x, 0.0), of)
        return hours, hours**2 / max(noise_hours, 1e-12)

    def future(self, x: Array, of: Figures, ahead: Future, rng: np.random.Generator) -> Array:
        """Return the distances from healthy at the times ``ahead``, ``(m, n)`` [-].

        ``x`` contains the present distances, ``(n,)`` [-].
        """
        x = np.maximum(x, 0.0)
        return x + self.increment(x, of, ahead.time(ahead.paced))


def bent(bend_of: Callable[[float], float], bend: float) -> float:
    """Return the argument at which an increasing function equals ``bend``, found by bisection."""
    low, high = 1e-3, 500.0
    while high > low * (1.0 + 1e-12):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if bend_of(middle) < bend else (low, middle)
    return low
