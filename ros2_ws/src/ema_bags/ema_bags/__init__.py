# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of rosbag2 recordings in MCAP format.

``import ema_bags`` offers the names of ``ema_bags.api``; docs/python.md shows how to use
them. Reading does not require ROS.
"""

from typing import TYPE_CHECKING

from ema_core import __version__ as __version__
from ema_core.lazy import lazy_names

if TYPE_CHECKING:
    from ema_bags.api import *  # noqa: F403
else:
    __getattr__, __dir__ = lazy_names(__name__)
