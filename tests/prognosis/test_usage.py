"""The age of a unit at its tests: from counts, and from tests where nobody counts."""

import math
from collections.abc import Iterable

import pytest

from ema_monitor.prognosis.counts import Count, KeptCounts
from ema_monitor.prognosis.usage import Age, Usage

SECOND_NS = 1_000_000_000


def ages(usage: Usage, stamps_s: Iterable[float], hours_per_cycle: float = 0.0) -> list[Age]:
    """The age at tests at these times."""
    told = []
    for stamp_s in stamps_s:
        usage.pass_test()
        told.append(usage.at(round(stamp_s * SECOND_NS), hours_per_cycle))
    return told


def count(stamp_s: float, hours: float, cycles: int = 0) -> Count:
    return Count(round(stamp_s * SECOND_NS), hours, cycles)


def test_usage_is_the_latest_count_before_the_test():
    usage = Usage(Age())
    for stamp_s, hours in ((50, 5.0), (10, 1.0), (90, 9.0)):
        usage.tell(count(stamp_s, hours))
    told = ages(usage, (5, 20, 60, 60, 100))
    assert math.isnan(told[0].hours)
    assert [age.hours for age in told[1:]] == [1.0, 5.0, 5.0, 9.0]
    assert [age.cycles for age in told] == [1, 2, 3, 4, 5]


def test_of_counts_of_one_stamp_the_one_that_came_last_holds():
    usage = Usage(Age())
    for hours in (5.0, 6.0):
        usage.tell(count(10, hours))
    assert ages(usage, [20])[0].hours == 6.0


def test_counts_without_end_after_a_test_leave_the_one_that_applies():
    """A hundred a second, for ten minutes: the window waits for its identification meanwhile."""
    usage = Usage(Age())
    usage.tell(count(1, 5.0))
    for number in range(60_000):
        usage.tell(count(2 + number / 100, 6.0))
    assert ages(usage, [1.5])[0].hours == 5.0


@pytest.mark.parametrize("order", [(0.2, 0.5, 0.9), (0.9, 0.5, 0.2), (0.5, 0.9, 0.2)])
def test_of_the_counts_of_a_second_the_first_is_kept(order: tuple[float, ...]):
    kept = KeptCounts(10)
    for stamp_s in order:
        kept.add(count(stamp_s, 10.0 * stamp_s))
    assert kept.all() == [count(0.2, 2.0)]


def test_counted_cycles_hold_over_those_seen():
    usage = Usage(Age(100.0, 10))
    usage.tell(count(1, 200.0, 25))
    assert ages(usage, [2]) == [Age(200.0, 25, count(1, 200.0, 25))]


def test_tests_since_the_count_are_added_to_its_cycles():
    usage = Usage(Age(100.0, 10))
    usage.tell(count(1, 200.0, 25))
    assert [age.cycles for age in ages(usage, (2, 3, 4))] == [25, 26, 27]


def test_one_wrong_count_of_cycles_costs_one_test():
    usage = Usage(Age())
    told = []
    for number in range(1, 6):
        usage.tell(count(10 * number, 1.0 * number, 5_000_000 if number == 3 else number))
        told += ages(usage, [10 * number + 1])
    assert [age.cycles for age in told] == [1, 2, 5_000_000, 4, 5]


def test_tests_count_for_hours_where_nobody_counts():
    usage = Usage(Age(100.0, 10))
    usage.pass_test()
    assert ages(usage, [2], 7.0) == [Age(114.0, 12)]


@pytest.mark.parametrize("hours_per_cycle", [0.0, 7.0])
def test_count_holds_for_ten_tests_and_is_not_gone_on_from_by_guessing(hours_per_cycle: float):
    usage = Usage(Age())
    usage.tell(count(1, 50.0))
    told = ages(usage, range(2, 14), hours_per_cycle)
    assert [age.hours for age in told[:10]] == [50.0] * 10
    assert all(math.isnan(age.hours) and age.count == count(1, 50.0) for age in told[10:])
    # One that comes again counts again.
    usage.tell(count(15, 130.0))
    assert ages(usage, [16], hours_per_cycle)[0].hours == 130.0


@pytest.mark.parametrize("hours", [-1.0, math.nan, math.inf, 1.1e7])
def test_impossible_hours_are_refused_by_name(hours: float):
    with pytest.raises(ValueError, match=r"flight_hours = .* h: expected .* \[0, 1e\+07\]"):
        Count(0, hours, 0)


@pytest.mark.parametrize("cycles", [-1, 10**12 + 1, 2**64 - 1])
def test_impossible_cycles_are_refused_by_name(cycles: int):
    with pytest.raises(ValueError, match=rf"cycles = {cycles}: expected .* in \[0, 1e\+12\]"):
        Count(0, 1.0, cycles)
