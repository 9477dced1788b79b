# SPDX-License-Identifier: Apache-2.0
"""Service life of a unit: received counts, and service hours at the tests."""

import math
import threading
from dataclasses import dataclass
from itertools import dropwhile, takewhile
from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.description import UnitKey
from ema_core.quantity import Checked, quantity
from ema_core.wording import counted
from ema_monitor.prognosis.events import (
    CountConfirmed,
    CountNotConfirmed,
    Occurrence,
    UncountedDropped,
)
from ema_monitor.prognosis.history_entry import Count, Entry

UNKNOWN_HOURS: Final = (
    "service hours are unknown: no count was received on topic usage before the test, and the "
    "parameter hours_per_cycle is 0"
)
"""Reason why a test without a count has no service hours."""

MOST_TESTS: Final = 10
"""Test cycles after which a count is outdated and the service hours are unknown."""

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
    """Assumptions about the usage of a unit."""

    duty: float = quantity(
        1.0, "-", 1e-3, 1e3, "growth of the faults in a future service hour, relative to a past one"
    )
    hours_per_cycle: float = quantity(
        0.0, "h", 0.0, 1e6, "service hours per test cycle; 0: from topic usage"
    )
    removal_risk: float = quantity(
        0.05, "-", 1e-3, 0.5, "accepted probability of a failure before the removal"
    )


class CountLog:
    """Service-life counts by unit: the first count in each second. Thread-safe.

    A count without serial number that is received before the actuator is described belongs to the
    unit that is described first. Beyond a thousand units, the unit with the oldest latest count is
    dropped. Beyond a thousand counts of a unit, its first count is dropped.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # By unit, ordered by the latest count.
        self._counts: dict[UnitKey, dict[int, Count]] = {}

    def add(self, unit: UnitKey, count: Count) -> None:
        """Add a count of a unit, whose serial number is empty while it is unknown.

        Within a second, the count with the earliest stamp is kept. If stamps are equal, the new
        count replaces the earlier one.
        """
        with self._lock:
            counts = self._counts[unit] = self._counts.pop(unit, {})
            # Keep the first count in each second.
            second = count.stamp_ns // _NS_PER_S
            if second not in counts or count.stamp_ns <= counts[second].stamp_ns:
                counts[second] = count
            if len(counts) > _MOST_COUNTS:
                del counts[next(iter(counts))]
            if len(self._counts) > _MOST_UNITS:
                del self._counts[next(iter(self._counts))]

    def assign(self, unit: UnitKey) -> None:
        """Assign an actuator's counts without serial number to its unit."""
        with self._lock:
            early = self._counts.pop((unit[0], ""), {})
            named = self._counts.pop(unit, {})
        # For equal stamps, the count with serial number replaces the count without.
        for count in (*early.values(), *named.values()):
            self.add(unit, count)

    def latest(self, unit: UnitKey, stamp_ns: int) -> Count | None:
        """Return the latest count of a unit up to ``stamp_ns``; None if there is none."""
        with self._lock:
            counts = self._counts.get(unit, {}).values()
            read = [count for count in counts if count.stamp_ns <= stamp_ns]
        return max(read, key=lambda count: count.stamp_ns, default=None)


class TimedTest(NamedTuple):
    """A test with its service hour."""

    stamp_ns: int
    """Time of the window's end, by which tests are ordered [ns]."""
    hours: float
    """Service hour [h]."""
    cycles: int
    """Test cycles up to and including the test."""
    is_counted: bool
    """Whether the hours are based on a count."""

    @classmethod
    def of(cls, entry: Entry, hours: float) -> Self:
        """Return a test of a history with its service hour [h]."""
        return cls(entry.stamp_ns, hours, entry.cycles, entry.count is not None)


class ServiceHours:
    """Non-decreasing service hours of one unit at its tests.

    A test with a new count has the hours of that count. A test without a new count is deferred
    until the next count and has hours interpolated by stamps, so that no fault grows in zero time.
    A count is held back if it is lower than the previous count, or if its hours per test cycle
    exceed ten times the largest so far. If the next count continues from it, both are used.
    Otherwise it is dropped, and its test has interpolated hours.

    The result depends only on the tests and their order, not on the time of the additions.

    Attributes
    ----------
    used
        Tests whose service hours are known, in the order of these hours.
    latest
        Latest test, used or not; None before the first.
    unknown
        Why the service hours at the latest test are unknown; empty when they are known, or when
        the test is deferred until the next count.
    """

    def __init__(self) -> None:
        self.used: list[TimedTest] = []
        self.latest: Entry | None = None
        self.unknown = ""
        # Tests since the latest used test, including the test with the held count.
        self._waiting: list[TimedTest] = []
        self._held: TimedTest | None = None
        # The first test with the latest count.
        self._counted: Entry | None = None
        # Used tests without a count, number of rates in hours per test cycle, and largest rate.
        self._uncounted = 0
        self._rates = 0
        self._most_rate = 0.0

    @property
    def hours(self) -> float:
        """Latest known service hours up to the latest test [h]; NaN when unknown."""
        return math.nan if self.unknown or not self.used else self.used[-1].hours

    @property
    def mean_hours_per_cycle(self) -> float:
        """Mean service hours per test cycle [h]; 0 if unknown."""
        cycles = self.used[-1].cycles - self.used[0].cycles if self.used else 0
        return max((self.used[-1].hours - self.used[0].hours) / cycles, 0.0) if cycles > 0 else 0.0

    @property
    def usage(self) -> float:
        """Present usage [h/d], over the tests of the last 90 days.

        NaN when the tests span less than a day, or when the usage exceeds 24 h/d: on a test bench
        or in a simulation, stamps and service hours come from different clocks.
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
        """Return the service hours of the used tests [h] by their stamps [ns]."""
        return {test.stamp_ns: test.hours for test in self.used}

    def after(self, cycles: int, hours_per_cycle: float) -> float:
        """Return the service hours at a later test [h], extrapolated by test cycles.

        Parameters
        ----------
        cycles
            Number of test cycles up to the test.
        hours_per_cycle
            Service hours per test cycle [h].
        """
        if not self.used:
            # A unit without known service hours counts as new.
            return hours_per_cycle * cycles
        latest = self.used[-1]
        return latest.hours + hours_per_cycle * max(cycles - latest.cycles, 0)

    def add(self, entry: Entry) -> list[Occurrence]:
        """Add the next test. Return events about its service hours."""
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

    def _drop_uncounted(self) -> list[Occurrence]:
        """Drop tests whose hours were computed from test cycles. Return the event, if any.

        Such hours cannot be combined with counts.
        """
        if not (dropped := self._uncounted):
            return []
        self.used = [test for test in self.used if test.is_counted]
        self._uncounted, self._rates, self._most_rate = 0, 0, 0.0
        return [UncountedDropped(dropped)]

    def _check(self, test: TimedTest) -> list[Occurrence]:
        """Use a test if its service hours are plausible; else hold it back until the next count.

        Returns an event if the next count confirms or contradicts the held count.
        """
        held = self._held
        if not self.used or self._is_plausible(self.used[-1], test):
            self._accept(test)
            if held is None:
                return []
            return [CountNotConfirmed(held.hours, held.cycles, test.hours)]
        before_hours = self.used[-1].hours
        if held is None or not self._is_plausible(held, test):
            self._held = test
            self._waiting.append(test)
            self.unknown = (
                f"service hours went from {before_hours:g} h to {test.hours:g} h: the test waits "
                "for the next count to confirm it"
            )
            return []
        kept = [test for test in self.used if test.hours <= held.hours]
        if dropped := len(self.used) - len(kept):
            self.used = kept
            # No hours can be interpolated for tests before the held test.
            since = dropwhile(lambda waiting: waiting.stamp_ns != held.stamp_ns, self._waiting)
            self._waiting = list(since)
        self._use(held)
        self._accept(test)
        return [CountConfirmed(before_hours, test.hours, dropped, held.hours)]

    def _is_plausible(self, before: TimedTest, after: TimedTest) -> bool:
        elapsed, most = after.hours - before.hours, self._most_rate
        if self._rates < _LEAST_TESTS or most == 0.0:
            return elapsed >= 0.0
        return 0.0 <= elapsed <= _IMPLAUSIBLE * most * _cycles(before, after)

    def _accept(self, test: TimedTest) -> None:
        """Use a test, and use its hours per test cycle to judge later tests."""
        rate = 0.0
        if self.used:
            rate = (test.hours - self.used[-1].hours) / _cycles(self.used[-1], test)
        self._rates += 1
        self._most_rate = max(self._most_rate, rate)
        self._use(test)

    def _use(self, test: TimedTest) -> None:
        """Use a test, preceded by the deferred tests at interpolated hours."""
        deferred = self._waiting
        earlier = list(takewhile(lambda waiting: waiting.stamp_ns != test.stamp_ns, deferred))
        self._waiting = deferred[len(earlier) + 1 :]
        if self.used:
            last = self.used[-1]
            span = max(test.stamp_ns - last.stamp_ns, 1)
            for waiting in earlier:
                share = min(max((waiting.stamp_ns - last.stamp_ns) / span, 0.0), 1.0)
                hours = last.hours + share * (test.hours - last.hours)
                self.used.append(waiting._replace(hours=max(hours, self.used[-1].hours)))
        self.used.append(test)
        self._uncounted += not test.is_counted
        self._held, self.unknown = None, ""


def _cycles(before: TimedTest, after: TimedTest) -> int:
    return max(after.cycles - before.cycles, 1)
