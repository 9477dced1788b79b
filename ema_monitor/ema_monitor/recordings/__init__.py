# SPDX-License-Identifier: Apache-2.0
"""Windows and service-life counts of a recording.

This package needs ``ema_bags``: install the extra ``bags``.
"""

from ema_monitor.recordings.finding import read_windows as read_windows
from ema_monitor.recordings.windows import BagWindows as BagWindows
from ema_monitor.recordings.windows import RecordedWindow as RecordedWindow
