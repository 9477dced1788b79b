# SPDX-License-Identifier: Apache-2.0
"""dx/du = 0: no growth."""

import numpy as np

from ema_core.arrays import Array
from ema_monitor.prognosis.growth.laws.interface import Figures, Future, Law, Levels


class Constant(Law):
    """Law without growth: the level is constant."""

    name = "constant"

    def advance(self, levels: Levels, of: Figures, hours: Array, noise_hours: float) -> None:
        pass

    def future(self, x: Array, of: Figures, ahead: Future, rng: np.random.Generator) -> Array:
        return np.broadcast_to(x, ahead.hours.shape)
