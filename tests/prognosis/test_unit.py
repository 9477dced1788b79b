# SPDX-License-Identifier: Apache-2.0
"""Published results of a unit after its tests, from history, tracker, requirements and usage."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ema_core.event_kinds import EventKind
from ema_core.faults import FAULT_NAMES, fault_vector
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_monitor.health import HealthLimits, assess
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.prognosis.event_texts import event_text, text_of
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.requirements.requirements import (
    REQUIREMENTS,
    RequirementLimits,
    Unmonitored,
    requirements_of,
)
from ema_monitor.prognosis.sentences import cause_of_level
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.reasons import StatedReason
from ema_monitor.unit import Unit

from .lived_units import (
    COUNTED,
    PARAMETERS,
    TEN_HOURS,
    backlash,
    follow,
    friction,
    lived,
    plain,
    worn,
)
from .made_tests import FIRST_NS, PERIOD_NS, UNIT, history_of, made_test


@pytest.fixture(scope="module")
def grown() -> tuple[Unit, list[Outlook]]:
    return lived(60, recorded=59)


@pytest.mark.slow
def test_life_is_reported_for_each_fault_and_requirement_and_the_earliest(grown):
    last = grown[1][-1]
    truth = 10.0 * (math.log(11.0) / 0.03 - 59)
    life = last.lives["friction"]
    assert life.known
    assert life.hours_05 < truth < life.hours_95
    assert life.hours_50 == pytest.approx(truth, rel=0.25)
    assert (last.flight_hours, last.cycles, last.hours_per_cycle) == (600.0, 60, 10.0)
    assert {"friction", "backlash", "gain", *REQUIREMENTS} <= last.lives.keys()
    assert "no significant growth" in last.lives["gain"].reason
    # Free play is equivalent to backlash: it fails at 49/99, shortly before 0.5.
    assert last.lives["free_play"].hours_50 == pytest.approx(
        last.lives["backlash"].hours_50, rel=0.1
    )
    assert last.rul_requirements.hours_50 <= last.lives["free_play"].hours_50
    assert last.rul.hours_50 == min(last.rul_faults.hours_50, last.rul_requirements.hours_50)
    assert last.rul.hours_05 <= last.rul.hours_50 <= last.rul.hours_95
    # By then, friction and backlash leave too little torque.
    assert last.rul.criterion == last.rul_requirements.criterion == "torque margin falls below 0.5"
    assert last.dominant_fault == "torque_margin"


def test_trends_agree_with_the_laws(grown):
    trends = grown[1][-1].trends
    assert trends["friction"] == pytest.approx(0.003 * (friction(59) + 0.05), rel=0.25)
    assert trends["backlash"] == pytest.approx(6e-4, rel=0.25)
    # BLK (1 + 99 k_2) tau
    assert trends["free_play"] == pytest.approx(1e-5 * 99 * trends["backlash"], rel=1e-6)
    # The model along the growth of friction and backlash, over an interval long enough to average
    # out that the peak torque jumps from one motor turn to the next: 8 % by itself.
    now = fault_vector({item.name: item.value for item in grown[1][-1].health.faults})
    growth = np.array([trends.get(name, 0.0) for name in FAULT_NAMES])
    growth *= [name in ("friction", "backlash") for name in FAULT_NAMES]
    requirements = requirements_of(PARAMETERS, RequirementLimits())
    assert not isinstance(requirements, Unmonitored)
    before, after = requirements.model.performance([now - 60 * growth, now + 60 * growth])[-1]
    assert trends["torque_margin"] == pytest.approx((after - before) / 120.0, rel=0.15)


def test_health_is_based_on_the_tracked_values(grown):
    prognostics, outlooks = grown
    last = outlooks[-1]
    [item] = [item for item in last.health.faults if item.name == "friction"]
    single = prognostics.history.entries[-1].estimate
    assert item.value != single.faults[0]
    assert item.value == pytest.approx(friction(59), abs=0.006)
    assert item.sigma < 0.004
    assert item.level == WARN
    assert last.health.health_index == pytest.approx(1.0 - max(i.share for i in last.health.faults))
    assert [i.name for i in last.health.requirements] == list(REQUIREMENTS)


def test_healthy_actuator_gets_no_life_and_no_alarm():
    """The measurement errors are large enough to cause a false alarm."""
    prognostics = Unit(History(*UNIT), TEN_HOURS)
    for number in range(20):
        estimate = made_test(number, seed=11, friction=0.0, backlash=0.0, gain=0.5)
        last = prognostics.update(estimate, PARAMETERS, TEN_HOURS)
        assert last is not None
        assert (last.health.level, last.rul.known, last.dominant_fault) == (OK, False, "")
        assert last.rul.reason


def test_repeated_test_changes_nothing(grown):
    prognostics, outlooks = grown
    entries = len(prognostics.history.entries)
    same = prognostics.history.entries[59].estimate
    again = prognostics.update(same, PARAMETERS, TEN_HOURS)
    assert again is not None
    assert plain(again) == plain(outlooks[-1])
    assert ["already in the history" in text_of(event.occurrence) for event in again.events] == [
        True
    ]
    assert len(prognostics.history.entries) == entries


@pytest.mark.parametrize("number", [19, 7])
def test_different_test_at_the_time_of_another_makes_the_level_unknown(number: int):
    unit, outlooks = lived(20)
    outlook = unit.update(made_test(number, friction=0.9), PARAMETERS, TEN_HOURS)
    assert outlook is not None
    assert (outlook.health.level, outlook.last_level) == (STALE, outlooks[-1].health.level)
    assert "the order of the tests is unknown" in outlook.health.reason
    assert len(unit.history.entries) == 20


def test_phases_on_both_sides_of_half_a_turn_belong_to_the_same_test():
    unit = Unit(History(*UNIT), TEN_HOURS)
    for phase in (0.001, 0.999):
        test = replace(made_test(0, eccentricity_phase=phase), covariance=1e-5 * np.eye(8))
        outlook = unit.update(test, PARAMETERS, TEN_HOURS)
    assert outlook is not None
    assert "already in the history" in text_of(outlook.events[-1].occurrence)


def test_other_duty_is_answered_without_changing_the_unit(grown):
    prognostics, outlooks = grown
    twice_as_hard = replace(TEN_HOURS, service=replace(TEN_HOURS.service, duty=2.0))
    twice = prognostics.outlook(PARAMETERS, twice_as_hard)
    now = outlooks[-1]
    assert twice.future.factor == 2.0
    assert twice.lives["friction"].hours_50 == pytest.approx(now.lives["friction"].hours_50 / 2)
    assert twice.lives["free_play"].hours_50 == pytest.approx(
        now.lives["free_play"].hours_50 / 2, rel=0.05
    )
    assert "2 times as fast" in twice.assumption
    assert plain(prognostics.outlook(PARAMETERS, TEN_HOURS)) == plain(now)


def test_nothing_is_answered_without_a_history():
    with pytest.raises(ValueError, match="no history yet"):
        Unit(History(*UNIT)).outlook(PARAMETERS, TEN_HOURS)


def test_late_test_is_reported_and_changes_no_level():
    prognostics, before = lived(3)
    back = prognostics.update(made_test(-5), PARAMETERS, TEN_HOURS)
    assert back is not None
    assert any(
        "70 s older than the latest test" in text_of(event.occurrence) for event in back.events
    )
    assert (back.flight_hours, back.claim, back.health.level) == (
        before[-1].flight_hours, before[-1].claim, before[-1].health.level,
    )  # fmt: skip
    assert [test.entry.stamp_ns for test in prognostics.latest_tests(9)[0]] == sorted(
        test.entry.stamp_ns for test in prognostics.latest_tests(9)[0]
    )


def test_step_is_a_warning_at_once_and_an_error_when_confirmed():
    prognostics, _ = lived(20, recorded=19)
    outlooks: list[Any] = [
        prognostics.update(made_test(n, friction=0.7, backlash=backlash(n)), PARAMETERS, TEN_HOURS)
        for n in (20, 21)
    ]
    healths = [
        next(item for item in outlook.health.faults if item.name == "friction")
        for outlook in outlooks
    ]
    first, second = (outlook.events for outlook in outlooks)
    assert event_text(first[0]).startswith("outlier: friction 0.700")
    assert (healths[0].level, healths[0].value < 0.1) == (WARN, True)
    # The reported value comes from the test, and is not the value before.
    words = cause_of_level(outlooks[0])
    assert "friction 0.7 in the latest test, to be confirmed by the next test" in words
    assert any(event_text(event).startswith("step: friction") for event in second)
    assert healths[1].level == ERROR
    assert healths[1].value == pytest.approx(0.7, abs=0.02)


@pytest.mark.slow
def test_changed_limit_applies_to_the_whole_history():
    settings = replace(TEN_HOURS, limits=HealthLimits(friction=0.9))
    _, expected = lived(20, settings, recorded=19)
    prognostics, _ = lived(20, recorded=19)
    assert plain(prognostics.outlook(PARAMETERS, settings)) == plain(expected[-1])


def test_requirement_that_a_healthy_actuator_misses_is_reported():
    settings = replace(TEN_HOURS, requirements=RequirementLimits(bandwidth=60.0))
    _, outlooks = lived(2, settings)
    assert outlooks[-1].health.requirements == ()
    assert "misses the limit of 60 Hz" in outlooks[-1].rul_requirements.reason
    assert outlooks[-1].lives["bandwidth"].criterion == "bandwidth falls below 60 Hz"
    above = "tracking error exceeds the healthy actuator's by more than 0.0015 rad"
    assert outlooks[-1].lives["tracking_error"].criterion == above


def test_worst_requirement_with_a_warning_is_named_while_no_life_is_known():
    """Backlash well within its own limit reduces the torque margin."""
    prognostics = Unit(History(*UNIT), TEN_HOURS)
    estimates = [made_test(number, backlash=0.09) for number in range(3)]
    *_, last = [prognostics.update(estimate, PARAMETERS, TEN_HOURS) for estimate in estimates]
    assert last is not None
    assert not last.rul.known
    assert (last.health.level, last.dominant_fault) == (WARN, "torque_margin")
    assert all(item.level == OK for item in last.health.faults)


def test_renamed_history_is_reported_with_the_first_test(tmp_path: Path):
    path = tmp_path / "history.sqlite"
    path.write_text("nothing\n")
    prognostics, outlooks = lived(2, path=path)
    prognostics.history.close()
    assert "renamed to" in text_of(outlooks[0].events[0].occurrence)
    assert outlooks[1].events == ()


@pytest.mark.slow
def test_fault_without_known_growth_ends_no_life(grown, monkeypatch: pytest.MonkeyPatch):
    unit, _ = grown
    expected = unit.outlook(PARAMETERS, TEN_HOURS)
    futures = Tracker.futures

    def of_wide_gain(*arguments: Any) -> Any:
        """Return futures in which the gain, which is not known to grow, takes any value."""
        paths = futures(*arguments)
        paths[1:, :, -1] = np.linspace(0.0, 1.0, paths.shape[1])
        return paths

    monkeypatch.setattr(Tracker, "futures", of_wide_gain)
    outlook = unit.outlook(PARAMETERS, TEN_HOURS)
    assert outlook.rul_requirements == expected.rul_requirements
    # Unknown lives are NaN, which does not equal itself.
    assert repr(outlook.lives) == repr(expected.lives)


@pytest.mark.slow
@pytest.mark.parametrize("hidden", ["eccentricity", "backlash"])
def test_component_that_no_test_has_shown_ends_no_life(hidden: str):
    tests = [made_test(number, seed=3, friction=friction(number)) for number in range(40)]
    number = FAULT_NAMES.index(hidden)
    for test in tests:
        test.covariance[number], test.covariance[:, number] = np.nan, np.nan
        test.unobservable[number] = True
    outlook = Unit(history_of(tests), TEN_HOURS).outlook(PARAMETERS, TEN_HOURS)
    assert outlook.rul_faults.known
    assert outlook.rul_requirements.reason == f"no test has shown {hidden} yet"
    assert outlook.rul == outlook.rul_faults


def test_first_test_alone_ends_no_life():
    """Even a very bad first test may be an outlier: the tracker waits for one that agrees."""
    prognostics = Unit(History(*UNIT), TEN_HOURS)
    outlook = prognostics.update(made_test(0, backlash=0.4), PARAMETERS, TEN_HOURS)
    assert outlook is not None
    assert not outlook.rul_requirements.known
    assert "fewer than two tests" in outlook.rul_requirements.reason


def test_stray_count_does_not_switch_a_unit_by_cycles_to_counted_hours():
    """A permanent switch would leave the test after it without service hours."""
    prognostics = Unit(History(*UNIT))
    cycles = [worn(n, {0: 0.0, 5: 3.0}.get(n, math.nan)) for n in range(9)]
    outlooks = [item for item in follow(prognostics, cycles, TEN_HOURS) if item]
    assert [item.flight_hours for item in outlooks] == [10.0 * n for n in range(1, 10)]
    assert [text_of(event.occurrence) for item in outlooks for event in item.events] == [
        "usage is ignored, 3 h: hours_per_cycle = 10 h is set"
    ]
    alone = follow(Unit(History(*UNIT)), [worn(n) for n in range(9)], TEN_HOURS)[-1]
    assert alone is not None
    assert plain(outlooks[-1]) == plain(alone)


@pytest.mark.slow
def test_count_that_is_not_renewed_gives_no_growth_in_zero_time():
    """Counts arrive only before every fifth test; the prognosis equals that with all counts."""
    sparse = [worn(n, 10.0 * n if n % 5 == 0 else math.nan) for n in range(26)]
    prognostics = Unit(History(*UNIT))
    outlooks = follow(prognostics, sparse)
    full = follow(Unit(History(*UNIT)), [worn(n, 10.0 * n) for n in range(26)])
    last, expected = outlooks[-1], full[-1]
    assert last is not None
    assert expected is not None
    assert last.rul_faults.known
    assert last.rul_faults.hours_50 == pytest.approx(expected.rul_faults.hours_50, rel=1e-6)
    # Between counts, life starts from the latest count, and levels rest on the test itself.
    counted_last, between = outlooks[20], outlooks[23]
    assert counted_last is not None
    assert between is not None
    assert (between.flight_hours, between.rul_faults) == (200.0, counted_last.rul_faults)
    single = assess(prognostics.history.entries[23].estimate, HealthLimits())
    # The tracker holds NaN, which does not equal itself.
    assert repr(between.health.faults) == repr(single.faults)
    assert all(event.kind == "fault" for item in outlooks if item for event in item.events)


@pytest.mark.slow
@pytest.mark.parametrize("is_worn", [True, False])
def test_single_count_too_high_raises_no_alarm(is_worn: bool):
    """Growth is not extrapolated to unconfirmed hours, but alarms do not wait."""
    outlooks = []
    prognostics = Unit(History(*UNIT))
    for number in range(24):
        hours = 50_000.0 if number == 20 else 10.0 * (number + 1)
        estimate = worn(number).estimate if is_worn else made_test(number, seed=3, friction=0.1)
        count = Count(estimate.start_ns, hours, number + 1)
        outlooks.append(prognostics.update(estimate, PARAMETERS, COUNTED, count))
    levels = [item.health.level for item in outlooks[17:]]
    # The torque margin of a worn unit is near its limit at a single test as well.
    assert max(levels) <= (WARN if is_worn else OK)
    assert "went from 200 h to 50000 h" in outlooks[20].rul.reason
    single = assess(prognostics.history.entries[20].estimate, HealthLimits())
    # The tracker holds NaN, which does not equal itself.
    assert repr(outlooks[20].health.faults) == repr(single.faults)
    assert outlooks[20].health.health_index == single.health_index > 0.7


def after(*tests: Estimate) -> list[Outlook]:
    """Return the outlook after each test of a new unit."""
    outlooks = Unit(History(*UNIT), TEN_HOURS).follow(tests, None, TEN_HOURS)
    return [outlook for _, outlook in outlooks if outlook is not None]


def departed(number: int, *, valid: bool = True) -> Estimate:
    words = "departed (1 in 1,000 healthy tests does so): the current is rough"
    return replace(
        made_test(number, valid=valid), verdict=Verdict.DEPARTED, reasons=(StatedReason(words),)
    )


@pytest.mark.parametrize("valid", [True, False])
def test_departure_without_an_explanation_by_faults_is_a_warning_and_one_event(valid: bool):
    tests = [made_test(0), departed(1, valid=valid), departed(2, valid=valid), made_test(3)]
    outlooks = after(*tests)
    assert [outlook.health.level for outlook in outlooks] == [OK, WARN, WARN, OK]
    assert cause_of_level(outlooks[1]).startswith(departed(1).reason)
    kinds = [
        [event.kind for event in outlook.events if event.kind is EventKind.DEPARTURE]
        for outlook in outlooks
    ]
    assert kinds == [[], [EventKind.DEPARTURE], [], []]


def test_departure_of_a_first_test_is_a_warning_and_lowers_no_error():
    (first,) = after(departed(0, valid=False))
    assert (first.health.level, first.known_level) == (WARN, WARN)
    _, last = after(made_test(0, friction=0.8), departed(1, valid=False))
    assert (last.health.level, last.health.reason) == (ERROR, departed(1).reason)
    assert cause_of_level(last).startswith("friction 0.8 (failed")
    assert cause_of_level(last).endswith(departed(1).reason)


def test_late_departure_is_an_event_without_a_level():
    _, late = after(made_test(1), departed(0))
    assert late.health.level == OK
    assert [
        text_of(event.occurrence) for event in late.events if event.kind is EventKind.DEPARTURE
    ] == [departed(0).reason]


def test_same_window_without_estimate_counts_as_one_cycle(tmp_path: Path):
    path = tmp_path / "history.sqlite"
    for _ in range(3):
        prognostics = Unit(History(*UNIT, path), TEN_HOURS)
        follow(prognostics, [worn(0, valid=False)] * 2, TEN_HOURS)
        prognostics.history.close()
    prognostics = Unit(History(*UNIT, path), TEN_HOURS)
    # The same window with an estimate is used, but is no further cycle.
    first, second = follow(prognostics, [worn(0), worn(1)], TEN_HOURS)
    prognostics.history.close()
    assert first is not None
    assert second is not None
    assert [(item.flight_hours, item.cycles) for item in (first, second)] == [(10.0, 1), (20.0, 2)]


def test_counted_cycles_take_precedence_and_one_wrong_count_costs_one_test():
    prognostics = Unit(History(*UNIT))
    cycles = []
    for number in range(8):
        estimate = made_test(number)
        counted_cycles = {3: 5_000_000, 6: 0}.get(number, number + 20)
        count = Count(estimate.start_ns, 10.0 * number, counted_cycles)
        outlook = prognostics.update(estimate, None, COUNTED, count)
        assert outlook is not None
        cycles.append(outlook.cycles)
    # Without counts, observed cycles are added.
    assert cycles == [20, 21, 22, 5_000_000, 24, 25, 26, 27]


def test_unknown_hours_leave_life_unknown_and_health_to_the_estimate():
    prognostics, outlooks = lived(12, PrognosisSettings())
    last = outlooks[-1]
    assert math.isnan(last.flight_hours)
    assert last.cycles == 12
    for life in (last.rul, last.rul_faults, last.rul_requirements, *last.lives.values()):
        assert not life.known
        assert "service hours are unknown" in life.reason
    estimate = prognostics.history.entries[-1].estimate
    # The tracker holds NaN, which does not equal itself.
    assert repr(last.health.faults) == repr(assess(estimate, HealthLimits()).faults)


def test_count_received_after_the_test_does_not_apply_to_it():
    prognostics = Unit(History(*UNIT))
    late = Count(FIRST_NS + 1000 * PERIOD_NS, 50.0, 0)
    outlook = prognostics.update(made_test(0), None, COUNTED, late)
    assert outlook is not None
    assert "no count was received on topic usage" in outlook.rul.reason


def test_missed_tests_count_and_are_reported():
    _, outlooks = lived(20, missing=(7, 8, 12))
    events = {item.flight_hours: item.events for item in outlooks if item.events}
    assert any(
        "2 tests without a valid estimate" in text_of(event.occurrence) for event in events[100.0]
    )
    assert any(
        "1 test without a valid estimate" in text_of(event.occurrence) for event in events[140.0]
    )
    last = outlooks[-1]
    assert (last.flight_hours, last.cycles, last.hours_per_cycle) == (200.0, 20, 10.0)
