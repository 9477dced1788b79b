"""Counts of service life as they come, until tests ask for them."""

import threading
from typing import Final

from ema_core.description import UnitKey
from ema_monitor.prognosis.history_entry import Count

_MOST_COUNTS: Final = 1000
_MOST_UNITS: Final = 1000
_NS_PER_S: Final = 1_000_000_000
# No unit is without a serial number.
_UNNAMED: Final = ""


class CountLog:
    """Counts by unit, the first of each second; any thread may call.

    A count without serial number that comes before the actuator is described belongs to the unit
    that is described first. Of more than a thousand units, those without a count for longest are
    dropped; of more than a thousand counts of a unit, those that came first.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # The units, that of the latest count last.
        self._counts: dict[UnitKey, dict[int, Count]] = {}

    def add(self, unit: UnitKey, count: Count) -> None:
        """Keep a count of a unit, whose serial number is empty as long as that is not known.

        One of the very same stamp as an earlier one replaces it.
        """
        with self._lock:
            counts = self._counts[unit] = self._counts.pop(unit, {})
            # The first of each second.
            second = count.stamp_ns // _NS_PER_S
            if second not in counts or count.stamp_ns <= counts[second].stamp_ns:
                counts[second] = count
            if len(counts) > _MOST_COUNTS:
                del counts[next(iter(counts))]
            if len(self._counts) > _MOST_UNITS:
                del self._counts[next(iter(self._counts))]

    def assign(self, unit: UnitKey) -> None:
        """Move counts of an actuator that was not described yet to the unit that it is."""
        with self._lock:
            early = self._counts.pop((unit[0], _UNNAMED), {})
            named = self._counts.pop(unit, {})
        # Of counts of the same stamp, one that names the unit holds.
        for count in (*early.values(), *named.values()):
            self.add(unit, count)

    def latest(self, unit: UnitKey, stamp_ns: int) -> Count | None:
        """Return the latest count of a unit by a stamp [ns]; None when there is none."""
        with self._lock:
            counts = self._counts.get(unit, {}).values()
            read = [count for count in counts if count.stamp_ns <= stamp_ns]
        return max(read, key=lambda count: count.stamp_ns, default=None)
