"""dx/du = a (1 + b x): Archard's wear with impacts that grow with the play."""

import math
from typing import Final

from ema_monitor.prognosis.growth.laws.interface import BENDS, Curve, Law, bent

_STEEP: Final = 4.0
_SETTLING: Final = 0.7
"""Relative loss of speed between healthy and the limit for growth that slows down [-]."""


class Archard(Law):
    """Exponential growth; growth that slows down if b is below 0."""

    name = "archard"

    def curves(self, limit: float) -> list[Curve]:
        return [Curve(bent(_bend, bend) / limit) for bend in BENDS]

    def wandering(self, limit: float) -> list[float]:
        return [-_SETTLING / limit, bent(_bend, _STEEP) / limit]


def _bend(product: float) -> float:
    """Return the bend by b times the limit."""
    return (1.0 + product) * math.log1p(product) / product
