"""Service life of a unit: counts as they come, and the service hours at its tests."""

import math
import threading
from dataclasses import dataclass
from itertools import dropwhile, takewhile
from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.description import UnitKey
from ema_core.quantity import Checked, quantity
from ema_core.wording import counted
from ema_monitor.prognosis.history_entry import SERVICE_HOURS, Count, Entry, Finding

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
_MOST_COUNTS: Final = 1000
_MOST_UNITS: Final = 1000
_NS_PER_S: Final = 1_000_000_000
_DAY_NS: Final = 86_400 * _NS_PER_S
_RECENT_NS: Final = 90 * _DAY_NS
_MOST_HOURS_A_DAY: Final = 24.0


@dataclass(frozen=True)
class Service(Checked):
    """What a monitor assumes of use."""

    duty: float = quantity(
        1.0, "-", 1e-3, 1e3, "growth of the faults in a future flight hour, relative to a past one"
    )
    hours_per_cycle: float = quantity(
        0.0, "h", 0.0, 1e6, "flight hours for each test cycle; 0: from topic usage"
    )
    removal_risk: float = quantity(
        0.05, "-", 1e-3, 0.5, "probability of a failure before the removal that is accepted"
    )


class CountLog:
    """Counts by unit, the first of each second; any thread may call.

    A count without serial number that comes before the actuator is described belongs to the unit
    that is described first. Of more than a thousand units, those without a count for longest are
    dropped; of more than a thousand counts of a unit, those that came first.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # The units, ordered by their latest count.
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
            early = self._counts.pop((unit[0], ""), {})
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
        # Tests since the latest used one, including the test with the held count.
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

    @property
    def mean_hours_per_cycle(self) -> float:
        """Flight hours from a test cycle to the next [h]; 0 when not known."""
        cycles = self.used[-1].cycles - self.used[0].cycles if self.used else 0
        return max((self.used[-1].hours - self.used[0].hours) / cycles, 0.0) if cycles > 0 else 0.0

    @property
    def usage(self) -> float:
        """The present usage [h/d], over the last 90 days as far as there are tests.

        NaN when the tests do not span a day, or when more hours than a day has would be flown in
        one: on a test bench, or in a simulation, stamps and service hours are not of one clock.
        """
        if not self.used:
            return math.nan
        last = self.used[-1]
        latest_ns = np.maximum.accumulate([test.stamp_ns for test in self.used])
        first = self.used[int(np.searchsorted(latest_ns, last.stamp_ns - _RECENT_NS))]
        span_ns = last.stamp_ns - first.stamp_ns
        if span_ns < _DAY_NS:
            return math.nan
        rate = (last.hours - first.hours) / (span_ns / _DAY_NS)
        return rate if 0.0 < rate <= _MOST_HOURS_A_DAY else math.nan

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
        """Add the next test; return the findings about its hours."""
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
            Finding(
                SERVICE_HOURS,
                f"counted from now on: {_tests(dropped)} before, at hours by hours_per_cycle, "
                "left out",
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
                Finding(
                    SERVICE_HOURS,
                    f"{held.hours:g} h at test {held.cycles} not confirmed by the next count, "
                    f"{test.hours:g} h: interpolated instead",
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
        return [Finding(SERVICE_HOURS, text)]

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


def _cycles(before: TimedTest, after: TimedTest) -> int:
    return max(after.cycles - before.cycles, 1)


def _tests(number: int) -> str:
    return "the test" if number == 1 else f"the {number} tests"
