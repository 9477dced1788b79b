# SPDX-License-Identifier: Apache-2.0
"""Tracked growth laws by name, in the order of their cells in the grid.

To add a law, subclass ``interface.Law`` in a new module and list the class here.
"""

from collections.abc import Mapping
from typing import Final

from ema_monitor.prognosis.growth.laws.archard import Archard
from ema_monitor.prognosis.growth.laws.constant import Constant
from ema_monitor.prognosis.growth.laws.drift import Drift
from ema_monitor.prognosis.growth.laws.exponential import Exponential
from ema_monitor.prognosis.growth.laws.interface import Law
from ema_monitor.prognosis.growth.laws.jumps import Jumps
from ema_monitor.prognosis.growth.laws.linear import Linear
from ema_monitor.prognosis.growth.laws.logistic import Logistic
from ema_monitor.prognosis.growth.laws.power import Power
from ema_monitor.prognosis.growth.laws.self_heating import SelfHeating

TRACKED_LAWS: Final[Mapping[str, Law]] = {
    law.name: law()
    for law in (Constant, Linear, Exponential, Archard, SelfHeating, Power, Logistic, Drift, Jumps)
}
