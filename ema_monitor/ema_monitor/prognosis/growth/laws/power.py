"""x = (u / c)^p: growth that accelerates with age."""

from ema_monitor.prognosis.growth.laws.interface import BENDS, Curve, Law


class Power(Law):
    """A power of the age, which is its bend."""

    name = "power"

    def curves(self, limit: float) -> list[Curve]:
        return [Curve(bend) for bend in BENDS]
