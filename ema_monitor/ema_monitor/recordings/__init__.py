"""Windows and counts of the service life in a recording.

This package needs ``ema_bags``, of the extra ``bags``.
"""

from ema_monitor.recordings.finding import read_windows as read_windows
from ema_monitor.recordings.windows import BagWindows as BagWindows
from ema_monitor.recordings.windows import RecordedWindow as RecordedWindow
