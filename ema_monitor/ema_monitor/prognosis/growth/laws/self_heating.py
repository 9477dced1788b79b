"""dx/du = a exp(b x): insulation heated by its own short circuit."""

import math
from typing import Final

from ema_monitor.prognosis.growth.laws.interface import BENDS, Curve, Law, bent

_STEEP: Final = (2.0, 3.0, 4.5, 6.0, 9.0, 14.0)


class SelfHeating(Law):
    """Growth without bound in a finite time."""

    name = "self_heating"

    def curves(self, limit: float) -> list[Curve]:
        return [Curve(bent(_bend, bend) / limit) for bend in BENDS]

    def wandering(self, limit: float) -> list[float]:
        # Accelerating growth needs prior probability before its acceleration shows.
        return [bent(_bend, bend) / limit for bend in _STEEP]


def _bend(product: float) -> float:
    """Return the bend by b times the limit."""
    return math.expm1(product) / product
