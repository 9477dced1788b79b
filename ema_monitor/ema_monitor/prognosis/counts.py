"""Counts of a unit's service life, and which of them holds at a test."""

import threading
from dataclasses import dataclass
from typing import Final

from ema_core.quantity import is_finite_number

_MOST_HOURS: Final = 1e7
_MOST_CYCLES: Final = 10**12
_NS_PER_S: Final = 1_000_000_000


@dataclass(frozen=True)
class Count:
    """What somebody counted of a unit's use.

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


class KeptCounts:
    """Keeps the first count of each second, so that frequent ones do not push out all others.

    Counts may come in any order, and from any thread. One of the very same stamp as one that is
    kept takes its place.

    Parameters
    ----------
    most
        How many are kept; of more, those that came first are forgotten.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._lock = threading.Lock()
        self._by_second: dict[int, Count] = {}

    def add(self, count: Count) -> None:
        """Keep a count, unless there is an earlier one of the same second.

        Parameters
        ----------
        count
            The count.
        """
        second = count.stamp_ns // _NS_PER_S
        with self._lock:
            kept = self._by_second.get(second)
            if kept is None or count.stamp_ns <= kept.stamp_ns:
                self._by_second[second] = count
            if len(self._by_second) > self._most:
                del self._by_second[next(iter(self._by_second))]

    def at(self, stamp_ns: int) -> Count | None:
        """Return the latest count that was read by a time; None when there is none.

        Parameters
        ----------
        stamp_ns
            The time [ns].
        """
        read = [count for count in self.all() if count.stamp_ns <= stamp_ns]
        return max(read, key=lambda count: count.stamp_ns, default=None)

    def all(self) -> list[Count]:
        """Return what is kept, in the order in which each second was first told of."""
        with self._lock:
            return list(self._by_second.values())
