# SPDX-License-Identifier: Apache-2.0
"""Fault identification and prognosis for an electromechanical actuator, and its node.

``import ema_monitor`` offers the names of ``ema_monitor.api``; docs/python.md shows how to use
them.
"""

from typing import TYPE_CHECKING

from ema_core import __version__ as __version__
from ema_core.lazy import lazy_names

if TYPE_CHECKING:
    from ema_monitor.api import *  # noqa: F403
else:
    __getattr__, __dir__ = lazy_names(__name__)
