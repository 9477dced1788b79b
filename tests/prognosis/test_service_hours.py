"""Service hours at the tests of a unit: they never go back, and nothing grows in zero time."""

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest

from ema_monitor.prognosis.history_entry import SERVICE_HOURS, Count, Entry, Finding
from ema_monitor.prognosis.service import ServiceHours

from .made_tests import made_test

STALE = None


def counted_at(hours: Iterable[float | None]) -> list[Entry]:
    """Tests with these counts; None where the count is that of the test before."""
    entries, count = [], None
    for number, counted in enumerate(hours):
        estimate = made_test(number, friction=0.1)
        if counted is not None:
            count = Count(estimate.start_ns, counted, 0)
        entries.append(Entry(estimate, math.nan, number + 1, count))
    return entries


def by_cycles(number: int, hours: float) -> Entry:
    return Entry(made_test(number, friction=0.1), hours, number + 1)


def added(entries: Iterable[Entry]) -> tuple[ServiceHours, list[Finding]]:
    service = ServiceHours()
    return service, [event for entry in entries for event in service.add(entry)]


def hours_of(entries: Iterable[Entry]) -> list[float]:
    return [test.hours for test in added(entries)[0].used]


def test_test_with_a_new_count_is_at_its_hours_at_once():
    service = ServiceHours()
    counts = [0.0, 10.0, 20.0, 30.0]
    for number, entry in enumerate(counted_at(counts)):
        assert service.add(entry) == []
        assert [test.hours for test in service.used] == counts[: number + 1]
        assert (service.hours, service.unknown) == (counts[number], "")


def test_tests_on_one_count_are_interpolated_by_stamps_when_the_next_count_comes():
    """Ten tests on one count were at one and the same hour, so that faults grew in zero time."""
    entries = counted_at([0.0, *[STALE] * 9, 100.0, *[STALE] * 3])
    service, events = added(entries)
    assert events == []
    assert [test.hours for test in service.used] == pytest.approx([10.0 * n for n in range(11)])
    stamps = [entry.stamp_ns for entry in entries]
    assert [test.stamp_ns for test in service.used] == stamps[:11]
    # The tests since then wait; the hours published are those of the latest count.
    assert (service.hours, service.unknown) == (100.0, "")
    assert all(one.hours < other.hours for one, other in pairwise(service.used))


def test_count_that_is_not_renewed_has_stopped_after_ten_tests():
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
def test_one_wrong_count_costs_nothing_but_a_wait(wrong: float):
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
    assert finding.kind == SERVICE_HOURS
    assert finding.text == (
        f"{wrong:g} h at test 9 not confirmed by the next count, 90 h: interpolated instead"
    )
    assert service.add(entries[10]) == []
    assert [test.hours for test in service.used] == pytest.approx([10.0 * n for n in range(11)])


def test_long_pause_is_used_when_the_next_count_confirms_it():
    counts = [0.0, 10.0, 20.0, 30.0, 5000.0, 5010.0, 5020.0]
    service, events = added(counted_at(counts))
    assert [text for _, text in events] == ["set from 30 h to 5010 h"]
    assert [test.hours for test in service.used] == counts


def test_tests_without_a_new_count_while_one_is_held_are_interpolated():
    """Nothing may grow in zero time, be the count that is held confirmed or not."""
    head = [0.0, 10.0, 20.0, 30.0, STALE, 5000.0, STALE]
    confirmed = hours_of(counted_at([*head, 5020.0]))
    assert confirmed == pytest.approx([0, 10, 20, 30, 2515, 5000, 5010, 5020])
    dropped = hours_of(counted_at([*head, 70.0]))
    assert dropped == pytest.approx([10.0 * n for n in range(8)])


def test_count_that_agrees_with_neither_takes_the_place_of_the_one_held():
    service, events = added(counted_at([0.0, 10.0, 20.0, 30.0, 5000.0, 900.0, 910.0]))
    assert [text for _, text in events] == ["set from 30 h to 910 h"]
    assert [test.hours for test in service.used] == pytest.approx(
        [0.0, 10.0, 20.0, 30.0, 465.0, 900.0, 910.0]
    )


def test_count_that_began_anew_leaves_out_the_tests_at_more_hours():
    service, events = added(counted_at([10.0, 20.0, 30.0, 40.0, 0.0, 5.0, 15.0]))
    assert [text for _, text in events] == [
        "set from 40 h to 5 h: the 4 tests at more than 0 h left out"
    ]
    assert [test.hours for test in service.used] == [0.0, 5.0, 15.0]


def test_several_wrong_counts_that_agree_are_left_out_when_two_others_do():
    counts = [*(10.0 * n for n in range(6)), 7000.0, 7010.0, 80.0, 90.0, 100.0]
    service, events = added(counted_at(counts))
    assert [text for _, text in events] == [
        "set from 50 h to 7010 h",
        "set from 7010 h to 90 h: the 2 tests at more than 80 h left out",
    ]
    assert [test.hours for test in service.used] == [*counts[:6], 80.0, 90.0, 100.0]


@pytest.mark.parametrize(
    ("counts", "is_held"),
    [
        ((0.0, 10.0, 20.0, 120.0), False),
        ((0.0, 10.0, 20.0, 121.0), True),
        # Ten times the hours of as many test cycles.
        ((0.0, 10.0, 20.0, STALE, STALE, 300.0), False),
        # Two tests do not show how far apart they are, nor do tests at one and the same hour.
        ((0.0, 10.0, 1000.0), False),
        ((5.0, 5.0, 5.0, 5.0, 1000.0), False),
        ((5.0, 4.0), True),
    ],
)
def test_jump_beyond_ten_times_the_most_hours_a_cycle_is_held(counts, is_held: bool):
    service, _ = added(counted_at(counts))
    assert bool(service.unknown) == is_held


@pytest.mark.parametrize("seed", range(20))
def test_hours_never_go_back_and_do_not_depend_on_when_tests_are_added(seed: int):
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


def test_without_count_and_hours_per_cycle_hours_are_unknown():
    service, _ = added(counted_at([STALE, STALE]))
    assert "no count on topic usage was read before the test" in service.unknown
    assert "hours_per_cycle is 0" in service.unknown
    assert len(service.used) == 0


def test_hours_by_cycles_go_on_from_the_latest_known():
    service = ServiceHours()
    assert service.after(3, 7.0) == 21.0
    for entry in counted_at([100.0, 110.0]):
        service.add(entry)
    # A third test cycle had no valid estimate.
    assert service.after(4, 7.0) == 124.0
    service.add(by_cycles(3, 124.0))
    assert [test.hours for test in service.used] == [100.0, 110.0, 124.0]


def test_tests_at_hours_by_cycles_are_left_out_once_hours_are_counted():
    entries = counted_at([STALE] * 3 + [500.0, 510.0])
    guessed = [by_cycles(number, 10.0 * number) for number in range(3)]
    service, events = added([*guessed, *entries[3:]])
    assert [text for _, text in events] == [
        "counted from now on: the 3 tests before, at hours by hours_per_cycle, left out"
    ]
    assert [test.hours for test in service.used] == [500.0, 510.0]
