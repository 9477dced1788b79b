"""Health and life of a unit whose service hours are counted, by cycles, wrong or unknown."""

import math
from pathlib import Path

import pytest

from ema_core.levels import OK, WARN
from ema_monitor.health import HealthLimits, assess
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .lived_units import (
    COUNTED,
    PARAMETERS,
    TEN_HOURS,
    UNIT,
    follow,
    lived,
    plain,
    ten_hours_a_test,
    worn,
)
from .made_tests import FIRST_NS, PERIOD_NS, made_test


def test_stray_count_does_not_switch_a_unit_by_cycles_to_counted_hours():
    """It did for good, and the test after it had no service hours."""
    prognostics = Unit(History(*UNIT))
    cycles = [worn(n, 3.0 if n == 5 else math.nan) for n in range(9)]
    outlooks = [item for item in follow(prognostics, cycles, TEN_HOURS) if item]
    assert [item.hours for item in outlooks] == [10.0 * n for n in range(1, 10)]
    assert [event.text for item in outlooks for event in item.events] == [
        "usage is ignored, 3 h: hours_per_cycle = 10 h is set"
    ]
    alone = follow(Unit(History(*UNIT)), [worn(n) for n in range(9)], TEN_HOURS)[-1]
    assert alone is not None
    assert plain(outlooks[-1]) == plain(alone)


@pytest.mark.slow
def test_count_that_is_not_renewed_gives_no_growth_in_zero_time():
    """Counted before every fifth test alone: the prognosis is that of hours counted before each."""
    sparse = [worn(n, 10.0 * n if n % 5 == 0 else math.nan) for n in range(31)]
    prognostics = Unit(History(*UNIT))
    outlooks = follow(prognostics, sparse)
    full = follow(Unit(History(*UNIT)), [worn(n, 10.0 * n) for n in range(31)])
    last, expected = outlooks[-1], full[-1]
    assert last is not None
    assert expected is not None
    assert last.rul_faults.known
    assert last.rul_faults.hours_50 == pytest.approx(expected.rul_faults.hours_50, rel=1e-6)
    # Between counts, life is given from the latest count on, and levels rest on the test itself.
    counted_last, between = outlooks[25], outlooks[28]
    assert counted_last is not None
    assert between is not None
    assert (between.hours, between.rul_faults) == (250.0, counted_last.rul_faults)
    single = assess(prognostics.history.entries[28].estimate, HealthLimits())
    assert between.health.faults == single.faults
    assert all(event.kind == "fault" for item in outlooks if item for event in item.events)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [2_000.0, 50_000.0])
@pytest.mark.parametrize("is_worn", [True, False])
def test_one_count_too_high_raises_no_alarm(wrong: float, is_worn: bool):
    """Growth is not extrapolated to hours that nothing has confirmed."""
    outlooks = []
    prognostics = Unit(History(*UNIT))
    for number, hours in enumerate(ten_hours_a_test(24, at_20=wrong)):
        estimate = worn(number).estimate if is_worn else made_test(number, seed=3, friction=0.1)
        count = Count(estimate.start_ns, hours, number + 1)
        outlooks.append(prognostics.update(estimate, PARAMETERS, COUNTED, count))
    levels = [item.health.level for item in outlooks[17:]]
    # The torque margin of a worn unit is near its limit at a single test as well.
    assert max(levels) <= (WARN if is_worn else OK)
    assert not outlooks[20].rul.known
    single = assess(prognostics.history.entries[20].estimate, HealthLimits())
    assert outlooks[20].health.faults == single.faults
    assert outlooks[20].health.health_index == single.health_index > 0.7


def test_same_window_without_estimate_counts_as_one_cycle(tmp_path: Path):
    path = tmp_path / "history.sqlite"
    for _ in range(3):
        prognostics = Unit(History(*UNIT, path), TEN_HOURS)
        follow(prognostics, [worn(0, valid=False)] * 2, TEN_HOURS)
        prognostics.history.close()
    prognostics = Unit(History(*UNIT, path), TEN_HOURS)
    # The same window with an estimate is taken, but is no further cycle.
    first, second = follow(prognostics, [worn(0), worn(1)], TEN_HOURS)
    prognostics.history.close()
    assert first is not None
    assert second is not None
    assert [(item.hours, item.cycles) for item in (first, second)] == [(10.0, 1), (20.0, 2)]


def test_counted_cycles_hold_over_those_seen_and_one_wrong_count_costs_one_test():
    prognostics = Unit(History(*UNIT))
    cycles = []
    for number in range(8):
        estimate = made_test(number)
        counted_cycles = {3: 5_000_000, 6: 0}.get(number, number + 20)
        count = Count(estimate.start_ns, 10.0 * number, counted_cycles)
        outlook = prognostics.update(estimate, None, COUNTED, count)
        assert outlook is not None
        cycles.append(outlook.cycles)
    # Where none are counted, those seen are added.
    assert cycles == [20, 21, 22, 5_000_000, 24, 25, 26, 27]


def test_unknown_hours_leave_life_unknown_and_health_to_the_estimate():
    prognostics, outlooks = lived(12, PrognosisSettings())
    last = outlooks[-1]
    assert math.isnan(last.hours)
    assert last.cycles == 12
    for life in (last.rul, last.rul_faults, last.rul_requirements, *last.lives.values()):
        assert not life.known
        assert "service hours are unknown" in life.reason
    estimate = prognostics.history.entries[-1].estimate
    assert last.health.faults == assess(estimate, HealthLimits()).faults


def test_count_that_was_read_after_the_test_does_not_count_for_it():
    prognostics = Unit(History(*UNIT))
    late = Count(FIRST_NS + 1000 * PERIOD_NS, 50.0, 0)
    outlook = prognostics.update(made_test(0), None, COUNTED, late)
    assert outlook is not None
    assert "no count on topic usage was read before the test" in outlook.rul.reason


def test_alarm_does_not_wait_for_a_count_to_be_confirmed():
    prognostics = Unit(History(*UNIT))
    follow(prognostics, [worn(n, h) for n, h in enumerate(ten_hours_a_test(30))])
    count = Count(FIRST_NS + 29 * PERIOD_NS + 1, 3.0, 0)
    odd = prognostics.update(made_test(30, friction=0.3), PARAMETERS, COUNTED, count)
    assert odd is not None
    assert "went from 300 h to 3 h" in odd.rul.reason
    assert [i.value for i in odd.health.faults if i.name == "friction"] == [0.3]


def test_missed_tests_count_and_are_told():
    _, outlooks = lived(20, missing=(7, 8, 12))
    events = {item.hours: item.events for item in outlooks if item.events}
    assert any("2 tests without a valid estimate" in event.text for event in events[100.0])
    assert any("1 test without a valid estimate" in event.text for event in events[140.0])
    last = outlooks[-1]
    assert (last.hours, last.cycles, last.hours_per_cycle) == (200.0, 20, 10.0)
