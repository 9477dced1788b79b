# SPDX-License-Identifier: Apache-2.0
"""Growth by a user-defined law."""

import numpy as np

from ema_core.arrays import Array
from ema_monitor.prognosis.growth.laws.interface import Figures, Law
from ema_monitor.prognosis.growth.tracker_settings import GrowthLaw


class External(Law):
    """Adapter that adds process noise to a user-defined ``GrowthLaw``."""

    name = "external"

    def __init__(self, law: GrowthLaw) -> None:
        self._law = law

    def __str__(self) -> str:
        return str(self._law)

    def increment(self, x: Array, of: Figures, hours: Array) -> Array:
        return self._law.increment(x, of.rate, of.shape, hours)

    def hours_until(self, x: Array, of: Figures) -> Array:
        hours = self._law.hours_until(x, of.rate, of.shape, of.limit)
        return np.where(x >= of.limit, 0.0, hours)
