# SPDX-License-Identifier: Apache-2.0
"""Counts of service life reach their unit; hours at its tests always increase."""

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest

from ema_core.event_kinds import EventKind
from ema_monitor.prognosis.event_texts import text_of
from ema_monitor.prognosis.events import Occurrence
from ema_monitor.prognosis.history_entry import Count, Entry
from ema_monitor.prognosis.service import CountLog, ServiceHours, TimedTest

from .made_tests import FIRST_NS, made_test

STALE = None
DAY_NS = 86_400_000_000_000


def counted_at(hours: Iterable[float | None]) -> list[Entry]:
    """Return tests with these counts; None repeats the count of the test before."""
    entries, count = [], None
    for number, counted in enumerate(hours):
        estimate = made_test(number, friction=0.1)
        if counted is not None:
            count = Count(estimate.start_ns, counted, 0)
        entries.append(Entry(estimate, math.nan, number + 1, count))
    return entries


def by_cycles(number: int, hours: float) -> Entry:
    return Entry(made_test(number, friction=0.1), hours, number + 1)


def added(entries: Iterable[Entry]) -> tuple[ServiceHours, list[Occurrence]]:
    service = ServiceHours()
    return service, [event for entry in entries for event in service.add(entry)]


def test_test_with_a_new_count_has_its_hours_at_once():
    service = ServiceHours()
    counts = [0.0, 10.0, 20.0, 30.0]
    for number, entry in enumerate(counted_at(counts)):
        assert service.add(entry) == []
        assert [test.hours for test in service.used] == counts[: number + 1]
        assert (service.hours, service.unknown) == (counts[number], "")


def test_tests_with_one_count_are_interpolated_by_stamps_when_the_next_count_arrives():
    """Ten tests with one count would have the same hour, so that faults would grow in zero time."""
    entries = counted_at([0.0, *[STALE] * 9, 100.0, *[STALE] * 3])
    service, events = added(entries)
    assert events == []
    assert [test.hours for test in service.used] == pytest.approx([10.0 * n for n in range(11)])
    stamps = [entry.stamp_ns for entry in entries]
    assert [test.stamp_ns for test in service.used] == stamps[:11]
    # The later tests wait; the published hours are the hours at the latest count.
    assert (service.hours, service.unknown) == (100.0, "")
    assert all(earlier.hours < later.hours for earlier, later in pairwise(service.used))


def test_count_that_is_not_renewed_counts_as_stopped_after_ten_tests():
    entries = counted_at([0.0, *[STALE] * 11, 120.0])
    service = ServiceHours()
    for entry in entries[:10]:
        service.add(entry)
        assert (service.hours, service.unknown) == (0.0, "")
    service.add(entries[10])
    assert math.isnan(service.hours)
    assert "the latest count of service hours is 11 tests old" in service.unknown
    for entry in entries[11:]:
        service.add(entry)
    assert [test.hours for test in service.used] == pytest.approx([10.0 * n for n in range(13)])
    assert service.unknown == ""


@pytest.mark.parametrize("wrong", [3.0, 2000.0, 50_000.0])
def test_single_wrong_count_only_causes_a_wait(wrong: float):
    counts = [10.0 * n for n in range(12)]
    counts[8] = wrong
    service = ServiceHours()
    entries = counted_at(counts)
    for entry in entries[:8]:
        service.add(entry)
    assert service.add(entries[8]) == []
    assert service.unknown == (
        f"service hours went from 70 h to {wrong:g} h: the test waits for the next count to "
        "confirm it"
    )
    assert math.isnan(service.hours)
    assert len(service.used) == 8
    [finding] = service.add(entries[9])
    assert finding.kind is EventKind.SERVICE_HOURS
    assert text_of(finding) == (
        f"{wrong:g} h at test 9 not confirmed by the next count, 90 h: interpolated instead"
    )
    assert service.add(entries[10]) == []
    assert [test.hours for test in service.used] == pytest.approx([10.0 * n for n in range(11)])


CHANGED = {
    "a long pause that the next count confirms": (
        [0.0, 10.0, 20.0, 30.0, 5000.0, 5010.0, 5020.0],
        ["set from 30 h to 5010 h"],
        [0.0, 10.0, 20.0, 30.0, 5000.0, 5010.0, 5020.0],
    ),
    "tests without a new count while one is held that is confirmed": (
        [0.0, 10.0, 20.0, 30.0, STALE, 5000.0, STALE, 5020.0],
        ["set from 30 h to 5020 h"],
        [0.0, 10.0, 20.0, 30.0, 2515.0, 5000.0, 5010.0, 5020.0],
    ),
    "tests without a new count while one is held that is not": (
        [0.0, 10.0, 20.0, 30.0, STALE, 5000.0, STALE, 70.0],
        ["5000 h at test 6 not confirmed by the next count, 70 h: interpolated instead"],
        [10.0 * number for number in range(8)],
    ),
    "a count that agrees with neither takes the place of the one held": (
        [0.0, 10.0, 20.0, 30.0, 5000.0, 900.0, 910.0],
        ["set from 30 h to 910 h"],
        [0.0, 10.0, 20.0, 30.0, 465.0, 900.0, 910.0],
    ),
    "a count that began anew": (
        [10.0, 20.0, 30.0, 40.0, 0.0, 5.0, 15.0],
        ["set from 40 h to 5 h: the 4 tests at more than 0 h left out"],
        [0.0, 5.0, 15.0],
    ),
    "several wrong counts that agree, until two others do": (
        [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 7000.0, 7010.0, 80.0, 90.0, 100.0],
        [
            "set from 50 h to 7010 h",
            "set from 7010 h to 90 h: the 2 tests at more than 80 h left out",
        ],
        [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 80.0, 90.0, 100.0],
    ),
}


@pytest.mark.parametrize(("counts", "texts", "hours"), CHANGED.values(), ids=CHANGED)
def test_changed_count_is_used_if_the_next_one_confirms_it(counts, texts, hours):
    """Nothing may grow in zero time."""
    service, events = added(counted_at(counts))
    assert [text_of(event) for event in events] == texts
    assert [test.hours for test in service.used] == pytest.approx(hours)


@pytest.mark.parametrize(
    ("counts", "is_held"),
    [
        ((0.0, 10.0, 20.0, 120.0), False),
        ((0.0, 10.0, 20.0, 121.0), True),
        # Ten times the hours per test cycle.
        ((0.0, 10.0, 20.0, STALE, STALE, 300.0), False),
        # Two tests do not show the hours between tests, nor do tests at the same hour.
        ((0.0, 10.0, 1000.0), False),
        ((5.0, 5.0, 5.0, 5.0, 1000.0), False),
        ((5.0, 4.0), True),
    ],
)
def test_jump_beyond_ten_times_the_most_hours_per_cycle_is_held(counts, is_held: bool):
    service, _ = added(counted_at(counts))
    assert bool(service.unknown) == is_held


@pytest.mark.parametrize("seed", range(20))
def test_hours_never_decrease_and_do_not_depend_on_when_tests_are_added(seed: int):
    rng = np.random.default_rng(seed)
    counts = [None if rng.random() < 0.3 else float(rng.integers(0, 60)) for _ in range(25)]
    entries = counted_at([0.0, *counts])
    service = ServiceHours()
    for number, entry in enumerate(entries, 1):
        service.add(entry)
        hours = [test.hours for test in service.used]
        assert hours == sorted(hours)
        assert [test.hours for test in added(entries[:number])[0].used] == hours
        stamps = [test.stamp_ns for test in service.used]
        assert stamps == sorted(stamps)


def test_hours_without_count_and_hours_per_cycle_are_unknown():
    service, _ = added(counted_at([STALE, STALE]))
    assert "no count was received on topic usage" in service.unknown
    assert "hours_per_cycle is 0" in service.unknown
    assert len(service.used) == 0


def test_hours_by_cycles_continue_from_the_latest_known():
    service = ServiceHours()
    assert service.after(3, 7.0) == 21.0
    for entry in counted_at([100.0, 110.0]):
        service.add(entry)
    # The third test cycle had no valid estimate.
    assert service.after(4, 7.0) == 124.0
    service.add(by_cycles(3, 124.0))
    assert [test.hours for test in service.used] == [100.0, 110.0, 124.0]


def test_tests_at_hours_by_cycles_are_left_out_once_hours_are_counted():
    entries = counted_at([STALE] * 3 + [500.0, 510.0])
    guessed = [by_cycles(number, 10.0 * number) for number in range(3)]
    service, events = added([*guessed, *entries[3:]])
    assert [text_of(event) for event in events] == [
        "counted from now on: the 3 tests before, with hours from hours_per_cycle, left out"
    ]
    assert [test.hours for test in service.used] == [500.0, 510.0]


def usage(*days_and_hours: tuple[float, float]) -> float:
    """Return the usage [h/day] from tests at days of the calendar and service hours."""
    service = ServiceHours()
    service.used = [
        TimedTest(FIRST_NS + int(day * DAY_NS), hours, number, True)
        for number, (day, hours) in enumerate(days_and_hours)
    ]
    return service.usage


def test_usage_is_averaged_over_the_last_ninety_days():
    # 10 h per day at first, and 4 h per day later.
    days = ((0, 0), (100, 1000), (150, 1200), (200, 1400))
    assert usage(*days) == pytest.approx(4.0)


@pytest.mark.parametrize(
    "used",
    [
        (),
        ((0, 0),),
        ((0, 0), (0.5, 4)),
        ((0, 0), (2, 100)),
        ((0, 5), (3, 5)),
        ((0, 0), (100, 1000)),
    ],
)
def test_usage_is_unknown_without_dates_or_with_inconsistent_clocks(used):
    assert math.isnan(usage(*used))


SECOND_NS = 1_000_000_000
A, B, OTHER = ("flap", "A"), ("flap", "B"), ("rudder", "A")
UNNAMED = ("flap", "")


def count(stamp_s: float) -> Count:
    return Count(round(stamp_s * SECOND_NS), stamp_s, 0)


def latest(log: CountLog, unit: tuple[str, str], stamp_s: float = 1e6) -> float:
    count = log.latest(unit, round(stamp_s * SECOND_NS))
    return math.nan if count is None else count.hours


def test_latest_count_of_a_unit_by_a_time_is_returned_regardless_of_the_order():
    log = CountLog()
    for stamp_s in (50, 10, 90):
        log.add(A, count(stamp_s))
    log.add(B, count(70))
    assert math.isnan(latest(log, A, 5))
    assert [latest(log, A, stamp_s) for stamp_s in (10, 60, 89, 100)] == [10, 50, 50, 90]
    assert latest(log, B) == 70
    assert math.isnan(latest(log, OTHER))


def test_counts_before_any_description_belong_to_the_unit_described_first():
    log = CountLog()
    log.add(B, count(1))
    log.add(UNNAMED, count(2))
    log.add(("rudder", ""), count(4))
    log.assign(A)
    log.assign(B)
    assert (latest(log, A), latest(log, B)) == (2, 1)
    assert math.isnan(latest(log, OTHER))


def test_among_counts_with_one_stamp_the_one_that_names_the_unit_or_the_last_applies():
    log = CountLog()
    log.add(UNNAMED, Count(1, 5.0, 0))
    log.add(A, Count(1, 6.0, 0))
    log.add(UNNAMED, Count(1, 7.0, 0))
    log.assign(A)
    assert latest(log, A) == 6.0
    log.add(A, Count(1, 8.0, 0))
    assert latest(log, A) == 8.0


def test_frequent_counts_do_not_displace_the_applicable_one():
    """A hundred counts per second arrive for ten minutes, while a window waits."""
    log = CountLog()
    log.add(A, count(1))
    for number in range(60_000):
        log.add(A, count(2 + number / 100))
    assert latest(log, A, 1.5) == 1
    # The first count of each second is kept.
    assert latest(log, A, 3.99) == 3


def test_counts_are_kept_within_bounds():
    log = CountLog()
    for number in range(1500):
        log.add(("flap", f"{number}"), count(number))
        log.add(A, count(number))
    assert math.isnan(latest(log, ("flap", "400")))
    assert latest(log, ("flap", "1499")) == 1499
    # Counts arrive all the time; the latest thousand are kept.
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
