"""dx/du = a (x + x_0): self-reinforcing damage."""

from ema_monitor.prognosis.growth.laws.interface import Law


class Exponential(Law):
    """A law for ``KnownLaw`` only: it has the curves of ``archard``, with x_0 = 1 / b."""

    name = "exponential"
