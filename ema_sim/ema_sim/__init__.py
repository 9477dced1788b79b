# SPDX-License-Identifier: Apache-2.0
"""Reference model of an electromechanical actuator, its sensors, test bench and service life.

``import ema_sim`` exports the names of ``ema_sim.api``; docs/python.md shows their use.
"""

from typing import TYPE_CHECKING

from ema_core import __version__ as __version__
from ema_core.lazy import lazy_names

if TYPE_CHECKING:
    from ema_sim.api import *  # noqa: F403
else:
    __getattr__, __dir__ = lazy_names(__name__)
