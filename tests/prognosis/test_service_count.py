"""Counts of service life reach the unit that they are of, and no other."""

import math

import pytest

from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.service import CountLog

SECOND_NS = 1_000_000_000
A, B, OTHER = ("flap", "A"), ("flap", "B"), ("rudder", "A")
UNNAMED = ("flap", "")


def count(stamp_s: float) -> Count:
    return Count(round(stamp_s * SECOND_NS), stamp_s, 0)


def latest(log: CountLog, unit: tuple[str, str], stamp_s: float = 1e6) -> float:
    found = log.latest(unit, round(stamp_s * SECOND_NS))
    return math.nan if found is None else found.hours


def test_latest_count_of_a_unit_by_a_time_is_returned_whatever_the_order():
    log = CountLog()
    for stamp_s in (50, 10, 90):
        log.add(A, count(stamp_s))
    log.add(B, count(70))
    assert math.isnan(latest(log, A, 5))
    assert [latest(log, A, stamp_s) for stamp_s in (10, 60, 89, 100)] == [10, 50, 50, 90]
    assert latest(log, B) == 70
    assert math.isnan(latest(log, OTHER))


def test_counts_before_any_description_are_of_the_unit_described_first():
    log = CountLog()
    log.add(B, count(1))
    log.add(UNNAMED, count(2))
    log.add(("rudder", ""), count(4))
    log.assign(A)
    log.assign(B)
    assert (latest(log, A), latest(log, B)) == (2, 1)
    assert math.isnan(latest(log, OTHER))


def test_of_counts_of_one_stamp_one_that_names_the_unit_or_the_last_holds():
    log = CountLog()
    log.add(UNNAMED, Count(1, 5.0, 0))
    log.add(A, Count(1, 6.0, 0))
    log.add(UNNAMED, Count(1, 7.0, 0))
    log.assign(A)
    assert latest(log, A) == 6.0
    log.add(A, Count(1, 8.0, 0))
    assert latest(log, A) == 8.0


def test_frequent_counts_do_not_push_out_the_one_that_applies():
    """A hundred a second, for ten minutes: the window waits for its identification meanwhile."""
    log = CountLog()
    log.add(A, count(1))
    for number in range(60_000):
        log.add(A, count(2 + number / 100))
    assert latest(log, A, 1.5) == 1
    # The first of each second is kept.
    assert latest(log, A, 3.99) == 3


def test_counts_are_kept_within_bounds():
    log = CountLog()
    for number in range(1500):
        log.add(("flap", f"{number}"), count(number))
        log.add(A, count(number))
    assert math.isnan(latest(log, ("flap", "400")))
    assert latest(log, ("flap", "1499")) == 1499
    # Heard of all the time; the latest thousand counts of it.
    assert math.isnan(latest(log, A, 499))
    assert latest(log, A, 500) == 500


@pytest.mark.parametrize("hours", [-1.0, math.nan, math.inf, 1.1e7])
def test_impossible_hours_are_refused_by_name(hours: float):
    with pytest.raises(ValueError, match=r"flight_hours = .* h: expected .* \[0, 1e\+07\]"):
        Count(0, hours, 0)


@pytest.mark.parametrize("cycles", [-1, 10**12 + 1, 2**64 - 1])
def test_impossible_cycles_are_refused_by_name(cycles: int):
    with pytest.raises(ValueError, match=rf"cycles = {cycles}: expected .* in \[0, 1e\+12\]"):
        Count(0, 1.0, cycles)
