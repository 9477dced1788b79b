"""How long a unit has been in service: told on a topic, or counted in tests."""

import math
from collections import deque
from dataclasses import dataclass
from typing import Final

from ema_core.quantity import check_quantities, is_finite_number, quantity

UNKNOWN_HOURS: Final = (
    "service hours are unknown: nothing was heard on topic usage, and the parameter "
    "hours_per_cycle is 0"
)
"""Why a test has no service hours."""

_MOST_COUNTS: Final = 1000


@dataclass(frozen=True)
class Service:
    """What a monitor assumes of use.

    Raises
    ------
    ValueError
        When a figure is outside its range; the message names it.
    """

    duty: float = quantity(
        1.0, "-", 1e-3, 1e3, "growth of the faults in a future flight hour, relative to a past one"
    )
    hours_per_cycle: float = quantity(
        0.0,
        "h",
        0.0,
        1e6,
        "flight hours that a test cycle stands for, where no topic tells the hours; 0: unknown",
    )

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True)
class Count:
    """What somebody counted of a unit's use.

    Attributes
    ----------
    stamp_ns
        When the counts were read [ns].
    hours
        Hours in service since new [h].
    cycles
        Test cycles since new; 0 when they are not counted.

    Raises
    ------
    ValueError
        When a figure is impossible.
    """

    stamp_ns: int
    hours: float
    cycles: int

    def __post_init__(self) -> None:
        if not is_finite_number(self.hours) or self.hours < 0.0:
            raise ValueError(f"flight_hours = {self.hours:g} h: expected a number of at least 0")
        if self.cycles < 0:
            raise ValueError(f"cycles = {self.cycles}: expected a whole number of at least 0")


@dataclass(frozen=True)
class Age:
    """Age of a unit at a test.

    Attributes
    ----------
    hours
        Hours in service [h]; NaN when unknown.
    cycles
        Test cycles.
    count
        The count that tells so; None where nobody counted.
    """

    hours: float = math.nan
    cycles: int = 0
    count: Count | None = None


class Usage:
    """Tells the age of a unit at each of its tests.

    The latest count read before the test holds; where there is none, every test cycle stands for
    the hours of the parameter, beginning at the age of the latest test in the history.

    Parameters
    ----------
    start
        Age at the latest test in the history.
    new_tests
        Test cycles since then.
    """

    def __init__(self, start: Age, new_tests: int = 0) -> None:
        self._last = start
        self._new_tests = new_tests
        self._counts: deque[Count] = deque(maxlen=_MOST_COUNTS)

    def tell(self, count: Count) -> None:
        """Take note of a count; they may come in any order, and from any thread.

        Parameters
        ----------
        count
            The count.
        """
        self._counts.append(count)

    def pass_test(self) -> None:
        """Take note of a test cycle, be its window of use or not."""
        self._new_tests += 1

    def at(self, stamp_ns: int, hours_per_cycle: float) -> Age:
        """Return the age at the test that was taken note of last.

        Parameters
        ----------
        stamp_ns
            Stamp of the test [ns].
        hours_per_cycle
            Flight hours that a test cycle stands for [h]; 0 when not known.
        """
        new, self._new_tests = self._new_tests, 0
        cycles = self._last.cycles + new
        read = [item for item in list(self._counts) if item.stamp_ns <= stamp_ns]
        if read:
            # Of those with the same stamp the one that came last.
            count = max(reversed(read), key=lambda item: item.stamp_ns)
            self._last = Age(count.hours, max(count.cycles, cycles), count)
        elif hours_per_cycle > 0.0:
            # A unit whose age nobody told is taken for new.
            before = 0.0 if math.isnan(self._last.hours) else self._last.hours
            self._last = Age(before + hours_per_cycle * new, cycles)
        else:
            # The latest hours known are kept: a count may come, or the parameter be set.
            self._last = Age(self._last.hours, cycles)
            return Age(math.nan, cycles)
        return self._last
