"""Service hours of a unit: counted, stood in for by tests, contradicted, and kept by a restart."""

import math
from collections.abc import Iterable
from itertools import combinations, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from ema_monitor.estimate import Estimate
from ema_monitor.health import HealthLimits, assess
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.prognosis_settings import PrognosisSettings
from ema_monitor.prognosis.prognostics import Prognostics
from ema_monitor.prognosis.service_order import ServiceOrder
from ema_monitor.prognosis.usage import Age, Count, Service, Usage

from .lived_units import PARAMETERS, TEN_HOURS, UNIT, backlash, friction, lived, plain
from .made_tests import FIRST_NS, PERIOD_NS, made_test


class Cycle(NamedTuple):
    """A test cycle: its estimate, and what was counted before it; NaN when nothing was."""

    estimate: Estimate
    counted_hours: float = math.nan


def worn(number: int, counted_hours: float = math.nan, *, valid: bool = True) -> Cycle:
    estimate = made_test(
        number, seed=3, valid=valid, friction=friction(number), backlash=backlash(number)
    )
    return Cycle(estimate, counted_hours)


def follow(
    prognostics: Prognostics, cycles: Iterable[Cycle], settings: PrognosisSettings = TEN_HOURS
) -> list[Outlook | None]:
    """What is said after each of the cycles, without requirements."""
    told = []
    for estimate, hours in cycles:
        if not math.isnan(hours):
            prognostics.tell(Count(estimate.start_ns, hours, 0))
        told.append(prognostics.take(estimate, None, settings))
    return told


def counted(hours: Iterable[float]) -> list[Outlook]:
    """What is said of a unit of which somebody counted these hours before its tests."""
    told = follow(Prognostics(History(*UNIT)), [worn(n, h) for n, h in enumerate(hours)])
    return [outlook for outlook in told if outlook]


def ten_hours_a_test(n: int, **mistaken: float) -> list[float]:
    hours = [10.0 * (number + 1) for number in range(n)]
    for number, wrong in mistaken.items():
        hours[int(number.removeprefix("at_"))] = wrong
    return hours


@pytest.mark.parametrize("seed", range(20))
def test_used_are_the_most_tests_whose_hours_never_go_back(seed: int):
    """After each test, by trying all choices; and those in use stay where others are no more."""
    rng = np.random.default_rng(seed)
    hours = rng.integers(0, 8, 9).astype(float)
    order, before = ServiceOrder(), []
    for n in range(1, len(hours) + 1):
        revoked = order.add(hours[n - 1])
        used = order.used
        ascends = all(hours[a] <= hours[b] for a, b in pairwise(used))
        assert ascends
        assert used == sorted(set(used))
        larger = combinations(range(n), len(used) + 1)
        assert not any(all(hours[a] <= hours[b] for a, b in pairwise(c)) for c in larger)
        assert revoked == sorted(set(before) - set(used))
        if len(used) == len(before):
            assert used == before
        before = list(used)


def test_choice_keeps_what_it_need_not_change():
    order = ServiceOrder()
    for hours in (10.0, 20.0, 15.0, 30.0, 900.0, 40.0):
        order.add(hours)
    assert order.used == [0, 1, 3, 4]
    # 15 h would do as well as 20 h.
    assert order.add(50.0) == [4]
    assert order.used == [0, 1, 3, 5, 6]


def test_one_count_too_high_is_revoked_by_the_second_test_after_it():
    hours = ten_hours_a_test(22, at_18=50_000.0)
    told = counted(hours)
    wrong, contradicted, revoked, last = told[18:]
    assert wrong.hours == 50_000.0
    assert "went back from 50000 h to 200 h" in contradicted.rul.reason
    assert not contradicted.rul.known
    [event] = revoked.events
    assert event == (
        "service hours 50000 h at test 19 revoked: 2 tests since then, from 200 h on, "
        "contradict them"
    )
    # As if that test had had no valid estimate.
    without = Prognostics(History(*UNIT))
    cycles = [worn(n, h, valid=n != 18) for n, h in enumerate(hours)]
    *_, one_before, expected = follow(without, cycles)
    assert one_before is not None
    assert expected is not None
    assert (plain(revoked), plain(last)) == (plain(one_before), plain(expected))
    assert last.rul_faults.known


def test_one_count_too_low_costs_its_own_test_alone():
    told = counted(ten_hours_a_test(20, at_15=16.0))
    assert "went back from 150 h to 16 h" in told[15].events[0]
    assert [item.rul_faults.known for item in told[14:18]] == [True, False, True, True]
    assert not any("revoked" in event for item in told for event in item.events)


def test_several_counts_too_high_are_revoked_together_by_one_test_more():
    wrong = {f"at_{number}": 7000.0 + number for number in (10, 11, 12)}
    told = counted(ten_hours_a_test(18, **wrong))
    [at] = [n for n, item in enumerate(told) if "revoked" in " ".join(item.events)]
    assert at == 16
    assert "7010 h to 7012 h at 3 tests, 11 to 13, revoked: 4 tests" in told[16].events[0]
    assert told[17].hours == 180.0


def test_count_that_began_anew_is_told_with_every_test_and_what_to_do():
    told = counted([*ten_hours_a_test(6), *map(float, range(7))])
    assert "went back from 60 h to 0 h" in told[6].rul_faults.reason
    for number in range(7, 12):
        [event] = told[number].events
        assert event == told[number].rul_faults.reason
        assert f"as {number - 6} before it" in event
        assert "a count that began anew must go on from 60 h" in event
        assert "serial number of its own" in event
    # By then the new count has told more tests than the old one.
    assert "10 h to 60 h at 6 tests, 1 to 6, revoked: 7 tests" in told[12].events[0]


@pytest.mark.parametrize("seed", range(6))
def test_restart_at_any_test_goes_on_as_if_there_had_been_none(tmp_path: Path, seed: int):
    """Tests with and without estimate, counted, not counted, and counted wrongly."""
    rng = np.random.default_rng(seed)
    settings = PrognosisSettings(service=Service(hours_per_cycle=7.0))
    cycles = []
    for number in range(16):
        # In half of the lives nobody ever counts.
        kind = rng.choice(["none", "right", "high", "low"], p=[0.6, 0.2, 0.1, 0.1])
        right = 8.0 * number
        hours = {"none": math.nan, "right": right, "high": 9.0 * right, "low": right / 4}[kind]
        hours = math.nan if seed % 2 else hours
        cycles.append(worn(number, hours, valid=rng.random() > 0.3))
    path = tmp_path / "history.jsonl"
    live = Prognostics(History(*UNIT, path), settings)
    expected = []
    for number, cycle in enumerate(cycles, 1):
        expected += follow(live, [cycle], settings)
        if number % 4 == 3:
            # What a kill would leave.
            (tmp_path / f"{number}.jsonl").write_bytes(path.read_bytes())
    live.history.close()
    for number in (3, 7, 11, 15):
        again = Prognostics(History(*UNIT, tmp_path / f"{number}.jsonl"), settings)
        told = follow(again, cycles[number:], settings)
        again.history.close()
        assert [plain(one) if one else None for one in told] == [
            plain(one) if one else None for one in expected[number:]
        ]


def test_cycles_without_estimate_count_across_a_restart(tmp_path: Path):
    path = tmp_path / "history.jsonl"
    first, _ = lived(5, path=path, missing=(3, 4))
    first.history.close()
    second = Prognostics(History(*UNIT, path), TEN_HOURS)
    [outlook] = follow(second, [worn(5)])
    second.history.close()
    assert outlook is not None
    assert (outlook.hours, outlook.cycles) == (60.0, 6)
    assert "2 without a valid estimate" in outlook.events[0]


def test_unit_is_judged_after_a_restart_without_a_new_test(tmp_path: Path):
    path = tmp_path / "history.jsonl"
    first, told = lived(12, path=path)
    first.history.close()
    second = Prognostics(History(*UNIT, path), TEN_HOURS)
    resumed = second.resume(PARAMETERS, TEN_HOURS)
    second.history.close()
    assert resumed is not None
    assert plain(resumed) == plain(told[-1])
    assert Prognostics(History(*UNIT)).resume(PARAMETERS, TEN_HOURS) is None


def test_unknown_hours_leave_life_unknown_and_health_to_the_estimate():
    prognostics, told = lived(12, PrognosisSettings())
    last = told[-1]
    assert math.isnan(last.hours)
    assert last.cycles == 12
    for life in (last.rul, last.rul_faults, last.rul_requirements, *last.lives.values()):
        assert not life.known
        assert "service hours are unknown" in life.reason
    estimate = prognostics.history.entries[-1].estimate
    assert last.health.faults == assess(estimate, HealthLimits()).faults


def test_hours_that_go_back_are_told_and_left_out():
    prognostics, _ = lived(30)
    prognostics.tell(Count(FIRST_NS + 30 * PERIOD_NS, 3.0, 0))
    odd = prognostics.take(made_test(30, friction=0.3), PARAMETERS, TEN_HOURS)
    assert odd is not None
    assert "went back from 300 h to 3 h" in odd.events[0]
    assert "went back" in odd.rul.reason
    # The alarm does not wait for the count to be put right.
    assert [i.value for i in odd.health.faults if i.name == "friction"] == [0.3]
    prognostics.tell(Count(FIRST_NS + 31 * PERIOD_NS, 310.0, 0))
    good = prognostics.take(
        made_test(31, seed=3, friction=friction(31), backlash=backlash(31)), PARAMETERS, TEN_HOURS
    )
    assert good is not None
    assert (good.hours, good.rul.known) == (310.0, True)


def test_missed_tests_count_and_are_told():
    _, told = lived(20, missing=(7, 8, 12))
    events = {item.hours: item.events for item in told if item.events}
    assert any("2 without a valid estimate" in event for event in events[100.0])
    assert any("1 without a valid estimate" in event for event in events[140.0])
    assert (told[-1].hours, told[-1].cycles, told[-1].hours_per_cycle) == (200.0, 20, 10.0)


def test_usage_is_the_latest_count_before_the_test():
    usage = Usage(Age())
    for stamp_ns, hours in ((50, 5.0), (10, 1.0), (90, 9.0)):
        usage.tell(Count(stamp_ns, hours, 0))
    told = []
    for stamp_ns in (5, 20, 60, 60, 100):
        usage.pass_test()
        told.append(usage.at(stamp_ns, 0.0))
    assert math.isnan(told[0].hours)
    assert [age.hours for age in told[1:]] == [1.0, 5.0, 5.0, 9.0]
    assert [age.cycles for age in told] == [1, 2, 3, 4, 5]


def test_counted_cycles_hold_over_those_seen():
    usage = Usage(Age(100.0, 10))
    count = Count(1, 200.0, 25)
    usage.tell(count)
    usage.pass_test()
    assert usage.at(2, 7.0) == Age(200.0, 25, count)


def test_tests_count_for_hours_where_nobody_counts():
    usage = Usage(Age(100.0, 10))
    usage.pass_test()
    usage.pass_test()
    assert usage.at(2, 7.0) == Age(114.0, 12)


@pytest.mark.parametrize("hours", [-1.0, math.nan, math.inf])
def test_impossible_count_is_refused(hours: float):
    with pytest.raises(ValueError, match="flight_hours = "):
        Count(0, hours, 0)
