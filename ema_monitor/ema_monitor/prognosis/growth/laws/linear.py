"""dx/du = a: wear at a steady load."""

from ema_monitor.prognosis.growth.laws.interface import Curve, Law


class Linear(Law):
    """A straight line."""

    name = "linear"

    def curves(self, limit: float) -> list[Curve]:
        return [Curve()]

    def wandering(self, limit: float) -> list[float]:
        return [0.0]
