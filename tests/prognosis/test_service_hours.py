"""Service hours of a unit: counted, stood in for by tests, contradicted, and kept by a restart."""

import math
from pathlib import Path

import numpy as np
import pytest

from ema_core.levels import OK, WARN
from ema_monitor.health import HealthLimits, assess
from ema_monitor.prognosis.counts import Count
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.prognosis_settings import PrognosisSettings
from ema_monitor.prognosis.prognostics import Prognostics
from ema_monitor.prognosis.usage import Service

from .lived_units import (
    PARAMETERS,
    TEN_HOURS,
    UNIT,
    Cycle,
    backlash,
    counted,
    follow,
    friction,
    lived,
    plain,
    ten_hours_a_test,
    worn,
)
from .made_tests import FIRST_NS, PERIOD_NS, made_test


def test_one_count_too_high_is_revoked_by_the_second_test_after_it():
    hours = ten_hours_a_test(22, at_18=50_000.0)
    told = counted(hours)
    before, wrong, contradicted, revoked, last = told[17:]
    assert wrong.hours == 50_000.0
    assert not wrong.rul.known
    assert "jumped from 180 h to 50000 h" in wrong.rul.reason
    # As one test tells it, not as growth over 50,000 h would have it: then it is 0.
    assert wrong.health.level <= WARN
    assert wrong.health.health_index == pytest.approx(before.health.health_index, abs=0.03)
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


@pytest.mark.parametrize("wrong", [2_000.0, 50_000.0])
@pytest.mark.parametrize("is_worn", [True, False])
def test_one_count_too_high_raises_no_alarm(wrong: float, is_worn: bool):
    """Growth is not extrapolated to hours that nothing has confirmed."""
    told = []
    prognostics = Prognostics(History(*UNIT))
    for number, hours in enumerate(ten_hours_a_test(24, at_20=wrong)):
        estimate = worn(number).estimate if is_worn else made_test(number, seed=3, friction=0.1)
        prognostics.tell(Count(estimate.start_ns, hours, number + 1))
        told.append(prognostics.take(estimate, PARAMETERS, TEN_HOURS))
    levels = [item.health.level for item in told[17:]]
    # The torque margin of a worn unit is near its limit at a single test as well.
    assert max(levels) <= (WARN if is_worn else OK)
    assert not told[20].rul.known
    assert f"from 200 h to {wrong:g} h" in told[20].rul.reason
    assert told[20].events == (told[20].rul.reason,)
    single = assess(prognostics.history.entries[20].estimate, HealthLimits())
    assert told[20].health.faults == single.faults
    assert told[20].health.health_index == single.health_index > 0.7
    assert told[22].events[0].startswith(f"service hours {wrong:g} h at test 21 revoked")


def test_long_pause_is_believed_from_the_next_test_on():
    hours = [*ten_hours_a_test(20), *(5000.0 + 10.0 * n for n in range(4))]
    cycles = [worn(min(n, 20), h) for n, h in enumerate(hours)]
    # No growth in the pause: the same levels go on, as new tests.
    cycles[21:] = [
        Cycle(made_test(n, seed=3, friction=friction(20), backlash=backlash(20)), hours[n])
        for n in range(21, 24)
    ]
    prognostics = Prognostics(History(*UNIT))
    told = [item for item in follow(prognostics, cycles) if item]
    assert "jumped from 200 h to 5000 h" in told[20].rul.reason
    assert all(item.health.level <= WARN for item in told[20:])
    assert not any("jumped" in item.rul.reason for item in told[21:])
    assert [entry.hours for entry in prognostics.growth.in_use] == hours


def test_guessed_hours_are_left_out_once_hours_are_counted():
    """Ten hours a test were guessed, five are counted: no growth is seen in the difference."""
    cycles = [worn(n) for n in range(20)] + [worn(n, 5.0 * (n + 1)) for n in range(20, 32)]
    prognostics = Prognostics(History(*UNIT))
    told = [item for item in follow(prognostics, cycles) if item]
    assert told[20].events == (
        "service hours are counted from now on: the 20 tests before, whose hours were guessed by "
        "hours_per_cycle, are left out",
    )
    assert not any(item.events for item in told[21:])
    assert [entry.hours for entry in prognostics.growth.in_use] == [5.0 * n for n in range(21, 33)]
    # As if nothing had been guessed.
    alone = [item for item in follow(Prognostics(History(*UNIT)), cycles[20:]) if item]
    assert told[-1].rul_faults == alone[-1].rul_faults
    assert told[-1].rul_faults.known


def test_test_before_the_first_count_is_not_mixed_with_counted_ones():
    """Its stamp is before all counts, for instance of a bag that comes late."""
    prognostics = Prognostics(History(*UNIT))
    follow(prognostics, [worn(n, 5.0 * n) for n in range(5, 10)])
    [late] = [item for item in follow(prognostics, [worn(0)]) if item]
    assert "guessed by hours_per_cycle, and those of others are counted" in late.rul.reason
    assert len(prognostics.growth.in_use) == 5


@pytest.mark.parametrize("settings", [PrognosisSettings(), TEN_HOURS])
def test_count_that_stops_is_noticed_after_ten_tests(settings: PrognosisSettings, tmp_path: Path):
    path = tmp_path / "history.sqlite"
    prognostics = Prognostics(History(*UNIT, path), settings)
    cycles = [worn(n, h) for n, h in enumerate(ten_hours_a_test(20))]
    told = follow(prognostics, [*cycles, *(worn(n) for n in range(20, 31))], settings)
    # That of the 20th test holds for nine more.
    assert [item.hours for item in told[19:29] if item] == [200.0] * 10
    for number, item in enumerate(told[29:], 11):
        assert item is not None
        assert math.isnan(item.hours)
        assert item.rul.reason.startswith(
            f"service hours are unknown: the latest count of service hours is {number} tests old"
        )
    prognostics.history.close()
    again = Prognostics(History(*UNIT, path), settings)
    resumed = again.resume(None, settings)
    assert resumed is not None
    assert "is 12 tests old" in resumed.rul.reason
    [going_on, far, back] = follow(again, [worn(31), worn(32, 330.0), worn(33, 340.0)], settings)
    again.history.close()
    assert going_on is not None
    assert "is 13 tests old" in going_on.rul.reason
    assert far is not None
    assert "jumped from 200 h to 330 h" in far.rul.reason
    assert back is not None
    assert back.rul_faults.known


def test_reason_of_unknown_hours_is_true_where_a_count_came_later():
    prognostics = Prognostics(History(*UNIT))
    prognostics.tell(Count(FIRST_NS + 1000 * PERIOD_NS, 50.0, 0))
    [outlook] = follow(prognostics, [worn(0)], PrognosisSettings())
    assert outlook is not None
    assert "no count on topic usage was read before the test" in outlook.rul.reason
    assert "hours_per_cycle is 0" in outlook.rul.reason


def test_same_window_without_estimate_counts_as_one_cycle(tmp_path: Path):
    path = tmp_path / "history.sqlite"
    for _ in range(3):
        prognostics = Prognostics(History(*UNIT, path), TEN_HOURS)
        follow(prognostics, [worn(0, valid=False)] * 2)
        prognostics.history.close()
    prognostics = Prognostics(History(*UNIT, path), TEN_HOURS)
    # The same window with an estimate is taken, but is no further cycle.
    first, second = follow(prognostics, [worn(0), worn(1)])
    prognostics.history.close()
    assert first is not None
    assert second is not None
    assert [(item.hours, item.cycles) for item in (first, second)] == [(10.0, 1), (20.0, 2)]


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
    path = tmp_path / "history.sqlite"
    live = Prognostics(History(*UNIT, path), settings)
    expected = []
    for number, cycle in enumerate(cycles, 1):
        expected += follow(live, [cycle], settings)
        if number % 4 == 3:
            # What a kill would leave.
            (tmp_path / f"{number}.sqlite").write_bytes(path.read_bytes())
    live.history.close()
    for number in (3, 7, 11, 15):
        again = Prognostics(History(*UNIT, tmp_path / f"{number}.sqlite"), settings)
        told = follow(again, cycles[number:], settings)
        again.history.close()
        assert [plain(one) if one else None for one in told] == [
            plain(one) if one else None for one in expected[number:]
        ]


def test_cycles_without_estimate_count_across_a_restart(tmp_path: Path):
    path = tmp_path / "history.sqlite"
    first, _ = lived(5, path=path, missing=(3, 4))
    first.history.close()
    second = Prognostics(History(*UNIT, path), TEN_HOURS)
    [outlook] = follow(second, [worn(5)])
    second.history.close()
    assert outlook is not None
    assert (outlook.hours, outlook.cycles) == (60.0, 6)
    assert "2 without a valid estimate" in outlook.events[0]


def test_unit_is_judged_after_a_restart_without_a_new_test(tmp_path: Path):
    path = tmp_path / "history.sqlite"
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
    prognostics = Prognostics(History(*UNIT))
    follow(prognostics, [worn(n, h) for n, h in enumerate(ten_hours_a_test(30))])
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
