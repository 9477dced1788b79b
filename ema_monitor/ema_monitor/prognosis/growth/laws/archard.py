# SPDX-License-Identifier: Apache-2.0
"""dx/du = a (1 + b x): Archard wear with impacts that increase with backlash."""

import math
from typing import Final

from ema_monitor.prognosis.growth.laws.interface import BENDS, Curve, Law, bent

_STEEP: Final = 4.0
_SETTLING: Final = 0.7
"""Relative decrease of the growth rate from healthy to the limit, in decelerating growth [-]."""


class Archard(Law):
    """Exponential growth for b > 0, decelerating growth for b < 0."""

    name = "archard"

    def curves(self, limit: float) -> list[Curve]:
        return [Curve(bent(_bend, bend) / limit) for bend in BENDS]

    def wandering(self, limit: float) -> list[float]:
        return [-_SETTLING / limit, bent(_bend, _STEEP) / limit]


def _bend(product: float) -> float:
    """Return the bend of the curve (see `BENDS`), given the product of b and the limit [-]."""
    return (1.0 + product) * math.log1p(product) / product
