# SPDX-License-Identifier: Apache-2.0
"""dx = a du + s dW: drift with diffusion."""

import math
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.prognosis.growth.laws.interface import BENDS, Curve, Figures, Future, Law, Levels

_DIFFUSIONS: Final = (0.05, 0.1, 0.2)
"""Standard deviation of the diffusion over 1,000 h, as multiples of the limit [-]."""


class Drift(Law):
    """Wiener process with drift; its prior equals the prior of a law with all bends (`BENDS`)."""

    name = "drift"
    is_random = True
    either_side = True

    def curves(self, limit: float) -> list[Curve]:
        share = len(BENDS) / len(_DIFFUSIONS)
        spreads = [multiple * limit / math.sqrt(1000.0) for multiple in _DIFFUSIONS]
        return [Curve(0.0, share, spread) for spread in spreads]

    def advance(self, levels: Levels, of: Figures, hours: Array, noise_hours: float) -> None:
        levels.mean[:] += of.side * of.rate * hours
        levels.variance[:] += of.third**2 * hours

    def passage(
        self, x: Array, of: Figures, noise_hours: float, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        return self.hours_until(x, of), ((of.limit - x) / of.third) ** 2

    def future(self, x: Array, of: Figures, ahead: Future, rng: np.random.Generator) -> Array:
        return x + of.rate * ahead.hours + of.third * ahead.wiener
