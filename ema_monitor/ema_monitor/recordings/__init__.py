"""What a recording has for the monitor: its windows, and the counts of service life.

It needs ``ema_bags``, of the extra ``bags``.
"""

from ema_monitor.recordings.finding import read_windows as read_windows
from ema_monitor.recordings.windows import BagWindows as BagWindows
from ema_monitor.recordings.windows import RecordedWindow as RecordedWindow
