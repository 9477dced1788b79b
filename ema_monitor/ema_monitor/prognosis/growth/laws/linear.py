# SPDX-License-Identifier: Apache-2.0
"""dx/du = a: wear under a steady load."""

from ema_monitor.prognosis.growth.laws.interface import Curve, Law


class Linear(Law):
    """Linear growth."""

    name = "linear"

    def curves(self, limit: float) -> list[Curve]:
        return [Curve()]

    def wandering(self, limit: float) -> list[float]:
        return [0.0]
