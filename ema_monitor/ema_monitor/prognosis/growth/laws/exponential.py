# SPDX-License-Identifier: Apache-2.0
"""dx/du = a (x + x_0): self-reinforcing damage."""

from ema_monitor.prognosis.growth.laws.interface import Law


class Exponential(Law):
    """Exponential growth, for ``KnownLaw`` only; equivalent to ``archard`` with b = 1 / x_0."""

    name = "exponential"
