"""Service hours of a unit at its tests: counted on topic ``usage``, or by test cycles."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from ema_core.quantity import check_quantities, quantity
from ema_core.wording import counted
from ema_monitor.prognosis.history_entry import Entry

UNKNOWN_HOURS: Final = (
    "service hours are unknown: no count on topic usage was read before the test, and the "
    "parameter hours_per_cycle is 0"
)
"""Why a test without a count has no service hours."""

MOST_TESTS: Final = 10
"""Test cycles after which a count that is not renewed is taken to have stopped."""

_LEAST_TESTS: Final = 3
_IMPLAUSIBLE: Final = 10.0


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
        0.0, "h", 0.0, 1e6, "flight hours that a test cycle stands for; 0: topic usage counts them"
    )

    def __post_init__(self) -> None:
        check_quantities(self)


class TimedTest(NamedTuple):
    """A test and its service hour [h]."""

    entry: Entry
    hours: float


class ServiceHours:
    """Service hours of one unit at its tests, which never go back.

    A test with a new count is at the hours of that count. One without, for the count is still
    that of an earlier test, waits for the next count and is then at hours interpolated by stamps,
    so that nothing grows in zero time. A count that goes back, or by more than ten times the most
    hours a test cycle so far, is held until the next one: if that goes on from it, both are used;
    else it is dropped, and the test is at interpolated hours.

    The result depends on the tests and their order alone, not on when they are added.

    Attributes
    ----------
    used
        Tests whose service hours are known, in ascending order of these.
    latest
        Latest test, used or not; None before any.
    unknown
        Why the service hours at the latest test are not known; empty when they are, or when the
        test merely waits for the next count.
    """

    def __init__(self) -> None:
        self.used: list[TimedTest] = []
        self.latest: Entry | None = None
        self.unknown = ""
        self._waiting: list[Entry] = []
        self._held: TimedTest | None = None
        # Latest test with a count, and the first test with that count.
        self._counted: Entry | None = None
        self._most_hours_per_cycle = 0.0
        self._accepted = 0

    @property
    def hours(self) -> float:
        """Service hours at the latest test [h], or the latest known before it; else NaN."""
        return math.nan if self.unknown or not self.used else self.used[-1].hours

    def after(self, cycles: int, hours_per_cycle: float) -> float:
        """Return the service hours at a further test by the cycles since the latest known [h].

        Parameters
        ----------
        cycles
            Test cycles up to it.
        hours_per_cycle
            Flight hours that a test cycle stands for [h].
        """
        if not self.used:
            # A unit whose service hours were never known is taken for new.
            return hours_per_cycle * cycles
        known = self.used[-1]
        return known.hours + hours_per_cycle * max(cycles - known.entry.cycles, 0)

    def add(self, entry: Entry) -> list[str]:
        """Add the next test; return what is odd about its hours, in words.

        Parameters
        ----------
        entry
            The test.
        """
        self.latest = entry
        if entry.count is None:
            self.unknown = UNKNOWN_HOURS if math.isnan(entry.hours) else ""
            if not self.unknown:
                self._accept(TimedTest(entry, max(entry.hours, self._last_hours())))
            return []
        if self._counted is not None and entry.count == self._counted.count:
            self._waiting.append(entry)
            tests = entry.cycles - self._counted.cycles + 1
            if self._held is None:
                self.unknown = _stopped(tests) if tests > MOST_TESTS else ""
            return []
        self._counted = entry
        events = self._drop_uncounted()
        return events + self._check(TimedTest(entry, entry.count.hours))

    def _last_hours(self) -> float:
        return self.used[-1].hours if self.used else 0.0

    def _drop_uncounted(self) -> list[str]:
        """Leave out tests at hours by test cycles: they do not mix with counted ones."""
        counted = [test for test in self.used if test.entry.count is not None]
        dropped = len(self.used) - len(counted)
        if not dropped:
            return []
        self.used = counted
        self._most_hours_per_cycle, self._accepted = 0.0, 0
        return [
            f"service hours are counted from now on: {_tests(dropped)} before, at hours by "
            "hours_per_cycle, left out"
        ]

    def _check(self, test: TimedTest) -> list[str]:
        """Accept or hold a test with a new count."""
        held = self._held
        if not self.used or self._is_plausible(self.used[-1], test):
            self._accept(test)
            if held is None:
                return []
            return [
                f"service hours {held.hours:g} h at test {held.entry.cycles} not confirmed by the "
                f"next count, {test.hours:g} h: interpolated instead"
            ]
        if held is not None and self._is_plausible(held, test):
            return [self._set(held, test)]
        self._held = test
        self._waiting.append(test.entry)
        self.unknown = (
            f"service hours went from {self.used[-1].hours:g} h to {test.hours:g} h: the test "
            "waits for the next count to confirm it"
        )
        return []

    def _is_plausible(self, before: TimedTest, after: TimedTest) -> bool:
        elapsed = after.hours - before.hours
        if self._accepted < _LEAST_TESTS or not self._most_hours_per_cycle:
            return elapsed >= 0.0
        most = _IMPLAUSIBLE * self._most_hours_per_cycle * _cycles(before, after)
        return 0.0 <= elapsed <= most

    def _set(self, held: TimedTest, test: TimedTest) -> str:
        """Accept a count that was held and the one that confirms it; return the event."""
        event = f"service hours set from {self.used[-1].hours:g} h to {test.hours:g} h"
        number = self._waiting.index(held.entry)
        before, after = self._waiting[:number], self._waiting[number + 1 :]
        kept = [item for item in self.used if item.hours <= held.hours]
        if dropped := len(self.used) - len(kept):
            event += f": {_tests(dropped)} at more than {held.hours:g} h left out"
            # There are no hours between those before and those after.
            self.used, before = kept, []
        self._waiting = before
        self._use(held)
        self._waiting = after
        self._accept(test)
        return event

    def _accept(self, test: TimedTest) -> None:
        if self.used:
            last = self.used[-1]
            rate = (test.hours - last.hours) / _cycles(last, test)
            self._most_hours_per_cycle = max(self._most_hours_per_cycle, rate)
        self._accepted += 1
        self._use(test)

    def _use(self, test: TimedTest) -> None:
        """Use a test, and before it those that waited, at interpolated hours."""
        if self.used:
            last = self.used[-1]
            span = max(test.entry.stamp_ns - last.entry.stamp_ns, 1)
            for entry in self._waiting:
                share = min(max((entry.stamp_ns - last.entry.stamp_ns) / span, 0.0), 1.0)
                hours = last.hours + share * (test.hours - last.hours)
                self.used.append(TimedTest(entry, max(hours, self.used[-1].hours)))
        self.used.append(test)
        self._waiting, self._held, self.unknown = [], None, ""


def _cycles(before: TimedTest, after: TimedTest) -> int:
    return max(after.entry.cycles - before.entry.cycles, 1)


def _stopped(tests: int) -> str:
    age = counted(tests, "test")
    return f"service hours are unknown: the latest count of service hours is {age} old"


def _tests(number: int) -> str:
    return "the test" if number == 1 else f"the {number} tests"
