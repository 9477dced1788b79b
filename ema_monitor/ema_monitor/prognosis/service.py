"""Service life of a unit: the counts received, and the service hours at its tests."""

import math
import threading
from dataclasses import dataclass
from itertools import takewhile
from typing import Final, NamedTuple

from ema_core.description import UnitKey
from ema_core.quantity import check_quantities, quantity
from ema_core.wording import counted
from ema_monitor.prognosis.history_entry import Count, Entry

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
# No unit is without a serial number.
_UNNAMED: Final = ""


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
    """A test and its service hour [h]."""

    entry: Entry
    hours: float


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
        self._waiting: list[Entry] = []
        self._held: TimedTest | None = None
        # The first test with the latest count.
        self._counted: Entry | None = None
        # Of those used: how many hours a test cycle there are, and the most.
        self._rates = 0
        self._most_rate = 0.0

    @property
    def hours(self) -> float:
        """Service hours at the latest test [h], or the latest known before it; else NaN."""
        return math.nan if self.unknown or not self.used else self.used[-1].hours

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
        return known.hours + hours_per_cycle * max(cycles - known.entry.cycles, 0)

    def add(self, entry: Entry) -> list[str]:
        """Add the next test; return the events about its hours, in words."""
        self.latest = entry
        if entry.count is None:
            if math.isnan(entry.hours):
                self.unknown = UNKNOWN_HOURS
            else:
                least = self.used[-1].hours if self.used else 0.0
                self._accept(TimedTest(entry, max(entry.hours, least)))
            return []
        if self._counted is not None and entry.count == self._counted.count:
            self._waiting.append(entry)
            tests = entry.cycles - self._counted.cycles + 1
            if self._held is None:
                is_old = tests > MOST_TESTS
                self.unknown = f"{_STOPPED} is {counted(tests, 'test')} old" if is_old else ""
            return []
        self._counted = entry
        return self._drop_uncounted() + self._check(TimedTest(entry, entry.count.hours))

    def _drop_uncounted(self) -> list[str]:
        """Leave out tests at hours by test cycles: they do not mix with counted ones."""
        counted = [test for test in self.used if test.entry.count is not None]
        dropped = len(self.used) - len(counted)
        if not dropped:
            return []
        self.used, self._rates, self._most_rate = counted, 0, 0.0
        return [
            f"service hours are counted from now on: {_tests(dropped)} before, at hours by "
            "hours_per_cycle, left out"
        ]

    def _check(self, test: TimedTest) -> list[str]:
        """Use a test with a new count, or hold it until the next count."""
        held = self._held
        if not self.used or self._is_plausible(self.used[-1], test):
            self._accept(test)
            if held is None:
                return []
            return [
                f"service hours {held.hours:g} h at test {held.entry.cycles} not confirmed by the "
                f"next count, {test.hours:g} h: interpolated instead"
            ]
        change = f"from {self.used[-1].hours:g} h to {test.hours:g} h"
        if held is None or not self._is_plausible(held, test):
            self._held = test
            self._waiting.append(test.entry)
            self.unknown = (
                f"service hours went {change}: the test waits for the next count to confirm it"
            )
            return []
        event = f"service hours set {change}"
        kept = [item for item in self.used if item.hours <= held.hours]
        if dropped := len(self.used) - len(kept):
            event += f": {_tests(dropped)} at more than {held.hours:g} h left out"
            self.used = kept
            # There are no hours between those before the held test and its own.
            del self._waiting[: self._waiting.index(held.entry)]
        self._use(held)
        self._accept(test)
        return [event]

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
        earlier = list(takewhile(lambda entry: entry is not test.entry, self._waiting))
        self._waiting = self._waiting[len(earlier) + 1 :]
        if self.used:
            last = self.used[-1]
            span = max(test.entry.stamp_ns - last.entry.stamp_ns, 1)
            for entry in earlier:
                share = min(max((entry.stamp_ns - last.entry.stamp_ns) / span, 0.0), 1.0)
                hours = last.hours + share * (test.hours - last.hours)
                self.used.append(TimedTest(entry, max(hours, self.used[-1].hours)))
        self.used.append(test)
        self._held, self.unknown = None, ""


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
            by_second = self._counts[unit] = self._counts.pop(unit, {})
            second = count.stamp_ns // _NS_PER_S
            if count.stamp_ns <= by_second.get(second, count).stamp_ns:
                by_second[second] = count
            if len(by_second) > _MOST_COUNTS:
                del by_second[next(iter(by_second))]
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
            read = [c for c in self._counts.get(unit, {}).values() if c.stamp_ns <= stamp_ns]
        return max(read, key=lambda count: count.stamp_ns, default=None)


def _cycles(before: TimedTest, after: TimedTest) -> int:
    return max(after.entry.cycles - before.entry.cycles, 1)


def _tests(number: int) -> str:
    return "the test" if number == 1 else f"the {number} tests"
