"""Growth by jumps: a compound Poisson process (Lawless and Crowder 2004).

Of each rate there are cells without a jump since the latest test, and cells with one.
"""

from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.growth_laws import hours_until, increment
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY
from ema_monitor.prognosis.growth.laws.interface import BENDS, Curve, Figures, Future, Law, Levels
from ema_monitor.prognosis.growth.settings import LIFE_HOURS

JUMPS: Final = (12.0, 35.0, 100.0)
"""Jumps of a mean size from healthy to the limit [-]."""


class Jumps(Law):
    """Jumps of an exponential distribution, as probable as a law with all its bends."""

    name = "jumps"
    is_random = True
    copies = 2

    def curves(self, limit: float) -> list[Curve]:
        share = len(BENDS) / len(JUMPS)
        return [Curve(0.0, share, limit / jumps) for jumps in JUMPS]

    def increment(self, x: Array, of: Figures, hours: Array) -> Array:
        return increment("linear", x, of.rate, of.shape, hours)

    def hours_until(self, x: Array, of: Figures) -> Array:
        return hours_until("linear", x, of.rate, of.shape, of.limit)

    def advance(self, levels: Levels, of: Figures, hours: Array, noise_hours: float) -> None:
        """Let each cell have none, or at least one jump; what both were is merged."""
        weight, mean, variance = map(_paired, levels)
        total = weight.sum(axis=0)
        middle = np.sum(weight / total * mean, axis=0)
        variance[:] = np.sum(weight / total * (variance + (mean - middle) ** 2), axis=0)
        mean[:] = middle
        side, rate, _, jump, _ = (_paired(one)[1] for one in of)
        count = _paired(hours)[1] * rate / jump
        some = -np.expm1(-count)
        weight[:] = np.maximum(total * np.stack([1.0 - some, some]), LEAST_PROBABILITY)
        # Moments of a sum of exponential jumps of which there is at least one.
        grown = jump * np.divide(count, some, out=np.ones_like(count), where=some > 0.0)
        mean[1] += side * grown
        variance[1] += grown * (2.0 * jump + jump * count - grown)

    def passage(
        self, x: Array, of: Figures, noise_hours: float, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """Return the hours of as many jumps as lie below the limit, and the one beyond it."""
        hours = self.hours_until(np.maximum(x, 0.0), of)
        left, rate, jump = hours > 0.0, of.rate, of.scatter
        needed = 1 + rng.poisson(hours[left] * rate[left] / jump[left])
        hours[left] = rng.standard_gamma(needed) * jump[left] / rate[left]
        return hours, np.zeros_like(hours)

    def future(self, x: Array, of: Figures, ahead: Future, rng: np.random.Generator) -> Array:
        steps, between = np.diff(ahead.hours, axis=0, prepend=0.0), of.scatter / of.rate
        leaps = between * np.cumsum(rng.standard_gamma(rng.poisson(steps / between)), axis=0)
        x = np.maximum(x, 0.0)
        return x + self.increment(x, of, ahead.time(leaps))


def _paired(values: Array) -> Array:
    """Return a view of cells without and with a jump, ``(2, curves, rates)``."""
    return np.moveaxis(values.reshape(-1, 2, LIFE_HOURS[::2].size), 1, 0)
