"""Service life of a unit: the service hours at its tests."""

import math
from dataclasses import dataclass
from itertools import dropwhile, takewhile
from typing import Final, NamedTuple, Self

from ema_core.quantity import check_quantities, quantity
from ema_core.wording import counted
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.unit_event import SERVICE_HOURS, Finding

UNKNOWN_HOURS: Final = (
    "service hours are unknown: no count on topic usage was read before the test, and the "
    "parameter hours_per_cycle is 0"
)
"""Why a test without a count has no service hours."""

MOST_TESTS: Final = 10
"""Test cycles for which a count may go without a new one before the hours are unknown."""

_STOPPED: Final = "service hours are unknown: the latest count of service hours"
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
        0.0, "h", 0.0, 1e6, "flight hours for each test cycle; 0: from topic usage"
    )
    removal_risk: float = quantity(
        0.05, "-", 1e-3, 0.5, "probability of a failure before the removal that is accepted"
    )

    def __post_init__(self) -> None:
        check_quantities(self)


class TimedTest(NamedTuple):
    """A test at its service hour.

    Attributes
    ----------
    stamp_ns, cycles
        As of ``Entry``.
    hours
        Service hour [h].
    is_counted
        Whether the hours rest on a count.
    """

    stamp_ns: int
    hours: float
    cycles: int
    is_counted: bool

    @classmethod
    def of(cls, entry: Entry, hours: float) -> Self:
        """Return a test of a history at a service hour [h]."""
        return cls(entry.stamp_ns, hours, entry.cycles, entry.count is not None)


class ServiceHours:
    """Service hours of one unit at its tests, which never go back.

    A test with a new count is at the hours of that count. One without waits for the next count and
    is then at hours interpolated by stamps, so that nothing grows in zero time. A count that goes
    back, or by more than ten times the most hours a test cycle so far, is held until the next one:
    if that goes on from it, both are used; else it is dropped, and the test is at interpolated
    hours.

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
        # Tests since the latest used one, that of the held count among them.
        self._waiting: list[TimedTest] = []
        self._held: TimedTest | None = None
        # The first test with the latest count.
        self._counted: Entry | None = None
        # Of those used: how many are not counted, how many hours a test cycle there are, and the
        # most.
        self._uncounted = 0
        self._rates = 0
        self._most_rate = 0.0

    @property
    def hours(self) -> float:
        """Service hours at the latest test [h], or the latest known before it; else NaN."""
        return math.nan if self.unknown or not self.used else self.used[-1].hours

    def by_stamp(self) -> dict[int, float]:
        """Return the service hours of those used [h] by their stamps [ns]."""
        return {test.stamp_ns: test.hours for test in self.used}

    def after(self, cycles: int, hours_per_cycle: float) -> float:
        """Return the service hours at a further test by the cycles since the latest known [h].

        Parameters
        ----------
        cycles, hours_per_cycle
            Test cycles up to it, and flight hours that a test cycle stands for [h].
        """
        if not self.used:
            # A unit whose service hours were never known counts as new.
            return hours_per_cycle * cycles
        known = self.used[-1]
        return known.hours + hours_per_cycle * max(cycles - known.cycles, 0)

    def add(self, entry: Entry) -> list[Finding]:
        """Add the next test; return what it reveals about its hours."""
        self.latest = entry
        if entry.count is None:
            if math.isnan(entry.hours):
                self.unknown = UNKNOWN_HOURS
            else:
                least = self.used[-1].hours if self.used else 0.0
                self._accept(TimedTest.of(entry, max(entry.hours, least)))
            return []
        if self._counted is not None and entry.count == self._counted.count:
            self._waiting.append(TimedTest.of(entry, math.nan))
            tests = entry.cycles - self._counted.cycles + 1
            if self._held is None:
                is_old = tests > MOST_TESTS
                self.unknown = f"{_STOPPED} is {counted(tests, 'test')} old" if is_old else ""
            return []
        self._counted = entry
        return self._drop_uncounted() + self._check(TimedTest.of(entry, entry.count.hours))

    def _drop_uncounted(self) -> list[Finding]:
        """Leave out tests at hours by test cycles: they do not mix with counted ones."""
        if not (dropped := self._uncounted):
            return []
        self.used = [test for test in self.used if test.is_counted]
        self._uncounted, self._rates, self._most_rate = 0, 0, 0.0
        return [
            _finding(
                f"counted from now on: {_tests(dropped)} before, at hours by hours_per_cycle, "
                "left out"
            )
        ]

    def _check(self, test: TimedTest) -> list[Finding]:
        """Use a test with a new count, or hold it until the next count."""
        held = self._held
        if not self.used or self._is_plausible(self.used[-1], test):
            self._accept(test)
            if held is None:
                return []
            return [
                _finding(
                    f"{held.hours:g} h at test {held.cycles} not confirmed by the next count, "
                    f"{test.hours:g} h: interpolated instead"
                )
            ]
        change = f"from {self.used[-1].hours:g} h to {test.hours:g} h"
        if held is None or not self._is_plausible(held, test):
            self._held = test
            self._waiting.append(test)
            self.unknown = (
                f"service hours went {change}: the test waits for the next count to confirm it"
            )
            return []
        text = f"set {change}"
        kept = [test for test in self.used if test.hours <= held.hours]
        if dropped := len(self.used) - len(kept):
            text += f": {_tests(dropped)} at more than {held.hours:g} h left out"
            self.used = kept
            # There are no hours between those before the held test and its own.
            since = dropwhile(lambda one: one.stamp_ns != held.stamp_ns, self._waiting)
            self._waiting = list(since)
        self._use(held)
        self._accept(test)
        return [_finding(text)]

    def _is_plausible(self, before: TimedTest, after: TimedTest) -> bool:
        elapsed, most = after.hours - before.hours, self._most_rate
        if self._rates < _LEAST_TESTS or most == 0.0:
            return elapsed >= 0.0
        return 0.0 <= elapsed <= _IMPLAUSIBLE * most * _cycles(before, after)

    def _accept(self, test: TimedTest) -> None:
        """Use a test, and its hours a test cycle to judge later ones by."""
        rate = 0.0
        if self.used:
            rate = (test.hours - self.used[-1].hours) / _cycles(self.used[-1], test)
        self._rates += 1
        self._most_rate = max(self._most_rate, rate)
        self._use(test)

    def _use(self, test: TimedTest) -> None:
        """Use a test, and before it those that waited, at interpolated hours."""
        waiting = self._waiting
        earlier = list(takewhile(lambda one: one.stamp_ns != test.stamp_ns, waiting))
        self._waiting = waiting[len(earlier) + 1 :]
        if self.used:
            last = self.used[-1]
            span = max(test.stamp_ns - last.stamp_ns, 1)
            for one in earlier:
                share = min(max((one.stamp_ns - last.stamp_ns) / span, 0.0), 1.0)
                hours = last.hours + share * (test.hours - last.hours)
                self.used.append(one._replace(hours=max(hours, self.used[-1].hours)))
        self.used.append(test)
        self._uncounted += not test.is_counted
        self._held, self.unknown = None, ""


def _finding(text: str) -> Finding:
    return Finding(SERVICE_HOURS, text)


def _cycles(before: TimedTest, after: TimedTest) -> int:
    return max(after.cycles - before.cycles, 1)


def _tests(number: int) -> str:
    return "the test" if number == 1 else f"the {number} tests"
