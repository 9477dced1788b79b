# SPDX-License-Identifier: Apache-2.0
"""Growth by jumps: a compound Poisson process with mean dx/du = a (1 + b x).

Each rate has two cells: without a jump since the latest test, and with at least one. The jump rate
increases with damage (Lawless and Crowder 2004, without b).
"""

from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY
from ema_monitor.prognosis.growth.laws.interface import BENDS, Curve, Figures, Future, Law, Levels
from ema_monitor.prognosis.growth.tracker_settings import LIFE_HOURS

JUMPS: Final = (12.0, 35.0, 100.0)
"""Numbers of jumps of average size from healthy to the limit [-]."""

_GROWING: Final = (0.0, 2.0)
"""Increase of the jump rate from healthy to the limit, relative to the healthy rate [-]."""


class Jumps(Law):
    """Exponentially distributed jumps; their prior equals the prior of a law with all bends."""

    name = "jumps"
    solution = "archard"
    is_random = True
    copies = 2

    def curves(self, limit: float) -> list[Curve]:
        share = len(BENDS) / len(JUMPS) / len(_GROWING)
        return [Curve(b / limit, share, limit / jumps) for jumps in JUMPS for b in _GROWING]

    def advance(self, levels: Levels, of: Figures, hours: Array, noise_hours: float) -> None:
        """Propagate each cell with and without jumps, and merge the results."""
        weight, mean, variance = map(_paired, levels)
        total = weight.sum(axis=0)
        middle = np.sum(weight / total * mean, axis=0)
        variance[:] = np.sum(weight / total * (variance + (mean - middle) ** 2), axis=0)
        mean[:] = middle
        side, jump = _paired(of.side)[1], _paired(of.third)[1]
        x = np.clip(_paired(of.side * levels.mean)[1], 0.0, 1.0)
        figures = Figures(*(_paired(column)[1] for column in of))
        count = self._count(x, figures, _paired(hours)[1])
        jump_probability = -np.expm1(-count)
        weight[:] = np.maximum(
            total * np.stack([1.0 - jump_probability, jump_probability]), LEAST_PROBABILITY
        )
        # Moments of the sum of at least one exponential jump.
        grown = jump * np.divide(
            count, jump_probability, out=np.ones_like(count), where=jump_probability > 0.0
        )
        mean[1] += side * grown
        variance[1] += grown * (2.0 * jump + jump * count - grown)

    def _count(self, x: Array, of: Figures, hours: Array) -> Array:
        """Return the expected number of jumps over the given hours [-]."""
        return np.minimum(self.increment(x, of, hours), 10.0) / of.third

    def passage(
        self, x: Array, of: Figures, noise_hours: float, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Return sampled first-passage times [h], and a shape of 0.

        The levels visited between jumps form a Poisson process.
        """
        x, numbers = np.maximum(x, 0.0), np.arange(x.size)
        left = np.maximum(of.limit - x, 0.0)
        between = np.repeat(numbers, rng.poisson(left / of.third))
        level = np.append(x, x[between] + left[between] * rng.random(between.size))
        number = np.append(numbers, between)
        rate = of.rate[number] * (1.0 + of.shape[number] * level) / of.third[number]
        waits = rng.standard_exponential(number.size) / rate
        hours = np.bincount(number, waits, x.size).astype(np.float64, copy=False)
        return np.where(left > 0.0, hours, 0.0), np.zeros_like(x)

    def future(self, x: Array, of: Figures, ahead: Future, rng: np.random.Generator) -> Array:
        steps, values = np.diff(ahead.hours, axis=0, prepend=0.0), np.empty(ahead.hours.shape)
        x = np.maximum(x, 0.0)
        for number, step in enumerate(steps):
            x = x + of.third * rng.standard_gamma(rng.poisson(self._count(x, of, step)))
            values[number] = x
        return values


def _paired(values: Array) -> Array:
    """Return a view of the cells without and with a jump, ``(2, curves, rates)``."""
    return np.moveaxis(values.reshape(-1, 2, LIFE_HOURS[::2].size), 1, 0)
