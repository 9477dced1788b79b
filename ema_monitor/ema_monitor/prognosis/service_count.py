"""Counts of a unit's service life, as received."""

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

from ema_core.quantity import is_finite_number

_MOST_HOURS: Final = 1e7
_MOST_CYCLES: Final = 10**12
_MOST_COUNTS: Final = 1000
_MOST_UNITS: Final = 1000
_NS_PER_S: Final = 1_000_000_000
# No unit is without a serial number.
_UNNAMED: Final = ""

Unit = tuple[str, str]
"""``actuator_id`` and ``serial_number``."""


@dataclass(frozen=True)
class Count:
    """Service life of a unit as it was counted.

    Attributes
    ----------
    stamp_ns
        When the counts were read [ns].
    hours
        Hours in service since new [h], at most 1e7.
    cycles
        Test cycles since new, at most 1e12; 0 when they are not counted.

    Raises
    ------
    ValueError
        When a figure is impossible; the message names it.
    """

    stamp_ns: int
    hours: float
    cycles: int

    def __post_init__(self) -> None:
        if not is_finite_number(self.hours) or not 0.0 <= self.hours <= _MOST_HOURS:
            raise ValueError(
                f"flight_hours = {self.hours:g} h: expected a number in [0, {_MOST_HOURS:g}]"
            )
        if not 0 <= self.cycles <= _MOST_CYCLES:
            raise ValueError(
                f"cycles = {self.cycles}: expected a whole number in [0, {_MOST_CYCLES:g}]"
            )


class CountLog:
    """Counts by unit, the first of each second; any thread may call.

    A count without serial number that comes before the actuator is described belongs to the unit
    that is described first. Of more than a thousand units, those not heard of for longest are
    dropped; of more than a thousand counts of a unit, those that came first.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: OrderedDict[Unit, dict[int, Count]] = OrderedDict()

    def add(self, unit: Unit, count: Count) -> None:
        """Keep a count.

        Parameters
        ----------
        unit
            The unit; its serial number is empty as long as that is not known.
        count
            The count; one of the very same stamp as an earlier one replaces it.
        """
        with self._lock:
            by_second = self._counts.setdefault(unit, {})
            self._counts.move_to_end(unit)
            second = count.stamp_ns // _NS_PER_S
            kept = by_second.get(second)
            if kept is None or count.stamp_ns <= kept.stamp_ns:
                by_second[second] = count
            if len(by_second) > _MOST_COUNTS:
                del by_second[next(iter(by_second))]
            if len(self._counts) > _MOST_UNITS:
                self._counts.popitem(last=False)

    def assign(self, unit: Unit) -> None:
        """Move counts of an actuator that was not described yet to the unit that it is.

        Parameters
        ----------
        unit
            The unit.
        """
        with self._lock:
            early = self._counts.pop((unit[0], _UNNAMED), {})
            named = self._counts.pop(unit, {})
        # Of counts of the same stamp, one that names the unit holds.
        for count in (*early.values(), *named.values()):
            self.add(unit, count)

    def latest(self, unit: Unit, stamp_ns: int) -> Count | None:
        """Return the latest count of a unit that was read by a time; None when there is none.

        Parameters
        ----------
        unit
            The unit.
        stamp_ns
            The time [ns].
        """
        with self._lock:
            read = [c for c in self._counts.get(unit, {}).values() if c.stamp_ns <= stamp_ns]
        return max(read, key=lambda count: count.stamp_ns, default=None)
