# SPDX-License-Identifier: Apache-2.0
"""x = (u / c)^p: growth that accelerates with age."""

from ema_monitor.prognosis.growth.laws.interface import BENDS, Curve, Law


class Power(Law):
    """Power law in age; the exponent is the bend of the curve."""

    name = "power"

    def curves(self, limit: float) -> list[Curve]:
        return [Curve(bend) for bend in BENDS]
