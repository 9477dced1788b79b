# SPDX-License-Identifier: Apache-2.0
"""dx/du = a exp(b x): insulation damage accelerated by the heat of the short circuit."""

import math
from typing import Final

from ema_monitor.prognosis.growth.laws.interface import BENDS, Curve, Law, bent

_STEEP: Final = (2.0, 3.0, 4.5, 6.0, 9.0, 14.0)


class SelfHeating(Law):
    """Accelerating growth that diverges in finite time."""

    name = "self_heating"

    def curves(self, limit: float) -> list[Curve]:
        return [Curve(bent(_bend, bend) / limit) for bend in BENDS]

    def wandering(self, limit: float) -> list[float]:
        # Accelerating growth needs prior probability before the acceleration becomes visible.
        return [bent(_bend, bend) / limit for bend in _STEEP]


def _bend(product: float) -> float:
    """Return the bend of the curve (see ``BENDS``), given the product of b and the limit [-]."""
    return math.expm1(product) / product
