# SPDX-License-Identifier: Apache-2.0
"""dx/du = a (x + x_0) (1 - x / K): self-reinforcing growth that saturates beyond the limit."""

from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.prognosis.growth.laws.interface import BENDS, Curve, Figures, Law

_TOPS: Final = (1.1, 1.3, 1.7)
"""Saturation levels K, as multiples of the limit [-]."""
_SEEDS: Final = (0.03, 0.12)
"""Initial offsets x_0, as multiples of the limit [-]."""


class Logistic(Law):
    """S-shaped growth; its prior is twice the prior of a law with all bends."""

    name = "logistic"

    def curves(self, limit: float) -> list[Curve]:
        share = 2.0 * len(BENDS) / len(_TOPS) / len(_SEEDS)
        return [Curve(top * limit, share, seed * limit) for top in _TOPS for seed in _SEEDS]

    def increment(self, x: Array, of: Figures, hours: Array) -> Array:
        x = np.minimum(x, of.shape)
        passed = of.rate * (1.0 + of.third / of.shape) * hours
        left = (of.shape - x) / (x + of.third) * np.exp(-passed)
        return (of.shape - of.third * left) / (1.0 + left) - x

    def hours_until(self, x: Array, of: Figures) -> Array:
        x, end = np.minimum(x, of.limit), of.limit
        gained = (end - x) * (of.shape + of.third) / (x + of.third) / (of.shape - end)
        return np.log1p(gained) / (of.rate * (1.0 + of.third / of.shape))
