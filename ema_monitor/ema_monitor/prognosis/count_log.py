"""Counts of service life as they come, until tests ask for them."""

import threading
from typing import Final, NamedTuple

import numpy as np

from ema_core.description import UnitKey
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.packed_rows import PackedRows

_MOST_COUNTS: Final = 1000
_MOST_UNITS: Final = 1000
_NS_PER_S: Final = 1_000_000_000
# No unit is without a serial number.
_UNNAMED: Final = ""


class _Row(NamedTuple):
    stamp_ns: int
    hours: float
    cycles: int


class _UnitCounts:
    """Counts of one unit, the first of each second, in little memory."""

    def __init__(self) -> None:
        self._rows = PackedRows(_Row)

    def add(self, count: Count) -> None:
        row = _Row(count.stamp_ns, count.hours, count.cycles)
        stamps_ns = self._rows.column("stamp_ns")
        same = np.flatnonzero(stamps_ns // _NS_PER_S == count.stamp_ns // _NS_PER_S)
        if not same.size:
            self._rows.append(row)
            if len(self._rows) > _MOST_COUNTS:
                self._rows = self._rows.only(np.arange(len(self._rows)) > 0)
        elif count.stamp_ns <= stamps_ns[same[0]]:
            self._rows[int(same[0])] = row

    def latest(self, stamp_ns: int) -> Count | None:
        stamps_ns = self._rows.column("stamp_ns")
        read = np.flatnonzero(stamps_ns <= stamp_ns)
        return Count(*self._rows[int(read[np.argmax(stamps_ns[read])])]) if read.size else None

    def all(self) -> list[Count]:
        return [Count(*row) for row in self._rows]


class CountLog:
    """Counts by unit, the first of each second; any thread may call.

    A count without serial number that comes before the actuator is described belongs to the unit
    that is described first. Of more than a thousand units, those without a count for longest are
    dropped; of more than a thousand counts of a unit, those that came first.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # The units, that of the latest count last.
        self._counts: dict[UnitKey, _UnitCounts] = {}

    def add(self, unit: UnitKey, count: Count) -> None:
        """Keep a count of a unit, whose serial number is empty as long as that is not known.

        One of the very same stamp as an earlier one replaces it.
        """
        with self._lock:
            counts = self._counts[unit] = self._counts.pop(unit, None) or _UnitCounts()
            counts.add(count)
            if len(self._counts) > _MOST_UNITS:
                del self._counts[next(iter(self._counts))]

    def assign(self, unit: UnitKey) -> None:
        """Move counts of an actuator that was not described yet to the unit that it is."""
        with self._lock:
            early = self._counts.pop((unit[0], _UNNAMED), None) or _UnitCounts()
            named = self._counts.pop(unit, None) or _UnitCounts()
        # Of counts of the same stamp, one that names the unit holds.
        for count in (*early.all(), *named.all()):
            self.add(unit, count)

    def latest(self, unit: UnitKey, stamp_ns: int) -> Count | None:
        """Return the latest count of a unit by a stamp [ns]; None when there is none."""
        with self._lock:
            counts = self._counts.get(unit)
            return counts.latest(stamp_ns) if counts else None
