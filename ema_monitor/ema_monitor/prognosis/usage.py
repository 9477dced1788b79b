"""How long a unit has been in service: told on a topic, or counted in tests."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Final, Self

from ema_core.quantity import check_quantities, quantity
from ema_monitor.prognosis.counts import Count, KeptCounts
from ema_monitor.prognosis.history_entry import Entry

UNKNOWN_HOURS: Final = (
    "service hours are unknown: no count on topic usage was read before the test, and the "
    "parameter hours_per_cycle is 0"
)
"""Why a test without a count has no service hours."""

MOST_TESTS: Final = 10
"""Tests for which a count holds."""

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
class Age:
    """Age of a unit at a test.

    Attributes
    ----------
    hours
        Hours in service [h]; NaN when unknown.
    cycles
        Test cycles.
    count
        The latest count; None where nobody counted.
    """

    hours: float = math.nan
    cycles: int = 0
    count: Count | None = None


class Usage:
    """Tells the age of a unit at each of its tests.

    The latest count read before the test holds, for ten tests: one that is older has stopped.
    Where nobody counted, every test cycle stands for the hours of the parameter, beginning at the
    age of the latest test in the history. Cycles are those of the count, if it has any, and the
    tests since it was first used; else those seen.

    Parameters
    ----------
    start
        Age at the latest test in the history.
    new_tests
        Test cycles since then.
    tests_on_count
        Test cycles up to the latest test for which its count held.
    """

    def __init__(self, start: Age, new_tests: int = 0, tests_on_count: int = 0) -> None:
        self._last = start
        self._new_tests = new_tests
        self._tests_on_count = tests_on_count
        self._counts = KeptCounts(_MOST_COUNTS)

    @classmethod
    def after(cls, entries: Sequence[Entry], new_tests: int) -> Self:
        """Return the use that is known after the tests in a history.

        Parameters
        ----------
        entries
            The tests.
        new_tests
            Test cycles since the latest of them.
        """
        if not entries:
            return cls(Age(), new_tests)
        last = entries[-1]
        known = (item.hours for item in reversed(entries) if not math.isnan(item.hours))
        *_, first = takewhile(lambda item: item.count == last.count, reversed(entries))
        on_count = last.cycles - first.cycles + 1
        usage = cls(Age(next(known, math.nan), last.cycles, last.count), new_tests, on_count)
        for entry in entries:
            if entry.count is not None:
                usage.tell(entry.count)
        return usage

    def tell(self, count: Count) -> None:
        """Take note of a count; they may come in any order, and from any thread.

        Parameters
        ----------
        count
            The count.
        """
        self._counts.add(count)

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
        before = self._last
        cycles = before.cycles + new
        count = self._counts.at(stamp_ns)
        if count is None:
            return self._guess(new, hours_per_cycle)
        if count == before.count:
            self._tests_on_count += new
        else:
            self._tests_on_count = 1
            cycles = count.cycles or cycles
        self._last = Age(count.hours, cycles, count)
        if self._tests_on_count > MOST_TESTS:
            return Age(math.nan, cycles, count)
        return self._last

    def _guess(self, new: int, hours_per_cycle: float) -> Age:
        """Return the age after new tests that nobody counted."""
        before, cycles = self._last.hours, self._last.cycles + new
        if hours_per_cycle > 0.0:
            # A unit whose age nobody told is taken for new.
            start = 0.0 if math.isnan(before) else before
            self._last = Age(start + hours_per_cycle * new, cycles)
            return self._last
        # The latest hours known are kept: a count may come, or the parameter be set.
        self._last = Age(before, cycles)
        return Age(math.nan, cycles)


def stopped_count(tests: int) -> str:
    """Return why a test has no service hours although somebody counted.

    Parameters
    ----------
    tests
        Test cycles for which the latest count has held, the test included.
    """
    return f"service hours are unknown: the latest count of service hours is {tests} tests old"
