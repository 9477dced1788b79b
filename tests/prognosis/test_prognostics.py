"""What is said of one unit after its tests: from history, tracker, requirements and usage."""

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from ema_core.levels import ERROR, OK, WARN
from ema_core.parameters import ActuatorParameters
from ema_monitor.health import HealthLimits, assess
from ema_monitor.prognosis import prognostics as prognostics_module
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook, earlier
from ema_monitor.prognosis.prediction import Life
from ema_monitor.prognosis.prognosis_settings import PrognosisSettings, duty_of
from ema_monitor.prognosis.prognostics import Prognostics
from ema_monitor.prognosis.required_life import requirements_of
from ema_monitor.prognosis.requirements import REQUIREMENTS, RequirementLimits
from ema_monitor.prognosis.settings import TrackerSettings
from ema_monitor.prognosis.tracker import Tracker
from ema_monitor.prognosis.usage import Age, Count, Service, Usage

from .made_tests import FIRST_NS, PERIOD_NS, made_test

PARAMETERS = ActuatorParameters()
TEN_HOURS = PrognosisSettings(service=Service(hours_per_cycle=10.0))
UNIT = ("flap", "SIM-0001")


def friction(number: int) -> float:
    """Exponential growth, at its limit of 0.5 in test 80."""
    return 0.05 * math.expm1(0.003 * 10.0 * number)


def backlash(number: int) -> float:
    return 0.006 * number


def lived(
    n: int,
    settings: PrognosisSettings = TEN_HOURS,
    path: Path | None = None,
    missing: tuple[int, ...] = (),
) -> tuple[Prognostics, list[Outlook]]:
    """A unit whose friction and backlash have grown over n tests."""
    prognostics = Prognostics(History(*UNIT, path), settings)
    told = []
    for number in range(n):
        valid = number not in missing
        estimate = made_test(
            number, seed=3, valid=valid, friction=friction(number), backlash=backlash(number)
        )
        outlook = prognostics.take(estimate, PARAMETERS, settings)
        assert (outlook is not None) == valid
        told += [outlook] if outlook else []
    return prognostics, told


@pytest.fixture(scope="module")
def worn() -> tuple[Prognostics, list[Outlook]]:
    return lived(60)


def plain(outlook: Outlook) -> str:
    """Everything in it but the events, each figure to its last digit."""
    return repr(replace(outlook, events=()))


def test_life_is_told_for_each_fault_and_requirement_and_the_earlier_of_both(worn):
    last = worn[1][-1]
    truth = 10.0 * (math.log(11.0) / 0.03 - 59)
    life = last.lives["friction"]
    assert life.known
    assert life.hours_05 < truth < life.hours_95
    assert life.hours_50 == pytest.approx(truth, rel=0.25)
    assert (last.hours, last.cycles, last.hours_per_cycle) == (600.0, 60, 10.0)
    assert {"friction", "backlash", "gain", *REQUIREMENTS} <= last.lives.keys()
    assert "no significant growth" in last.lives["gain"].reason
    # Free play is backlash in other words: it fails at 49/99, shortly before 0.5.
    assert last.lives["free_play"].hours_50 == pytest.approx(
        last.lives["backlash"].hours_50, rel=0.1
    )
    assert last.rul_requirements.hours_50 <= last.lives["free_play"].hours_50
    assert last.rul.hours_50 == min(last.rul_faults.hours_50, last.rul_requirements.hours_50)
    assert last.rul.hours_05 <= last.rul.hours_50 <= last.rul.hours_95
    # By then friction and backlash leave too little torque.
    assert last.rul.criterion == last.rul_requirements.criterion == "torque_margin >= 0.5"
    assert last.dominant == "torque_margin"


def test_trends_are_those_of_the_laws(worn):
    trends = worn[1][-1].trends
    assert trends["friction"] == pytest.approx(0.003 * (friction(59) + 0.05), rel=0.25)
    assert trends["backlash"] == pytest.approx(6e-4, rel=0.25)
    # BLK (1 + 99 k_2) tau
    assert trends["free_play"] == pytest.approx(1e-5 * 99 * trends["backlash"], rel=1e-6)


def test_health_is_that_of_the_tracked_values(worn):
    prognostics, told = worn
    last = told[-1]
    [item] = [item for item in last.health.faults if item.name == "friction"]
    single = prognostics.history.entries[-1].estimate
    assert item.value != single.faults[0]
    assert item.value == pytest.approx(friction(59), abs=0.006)
    assert item.sigma < 0.004
    assert item.level == WARN
    assert last.health.health_index == pytest.approx(1.0 - max(i.share for i in last.health.faults))
    assert [i.name for i in last.health.requirements] == list(REQUIREMENTS)


def test_healthy_actuator_is_told_no_life_and_no_alarm():
    prognostics = Prognostics(History(*UNIT), TEN_HOURS)
    for number in range(30):
        last = prognostics.take(made_test(number), PARAMETERS, TEN_HOURS)
        assert last is not None
        assert (last.health.level, last.rul.known, last.dominant) == (OK, False, "")
        assert last.rul.reason


def test_restart_changes_nothing(tmp_path: Path):
    path = tmp_path / "history.jsonl"
    _, expected = lived(40)
    first, _ = lived(25, path=path)
    # Killed: nothing is closed, but for the lock that goes with a process.
    first.history.close()
    second = Prognostics(History(*UNIT, path), TEN_HOURS)
    told = [
        second.take(
            made_test(number, seed=3, friction=friction(number), backlash=backlash(number)),
            PARAMETERS,
            TEN_HOURS,
        )
        for number in range(25, 40)
    ]
    assert [plain(item) for item in told if item] == [plain(item) for item in expected[25:]]
    second.history.close()


def test_same_test_again_changes_nothing(worn):
    prognostics, told = worn
    entries = len(prognostics.history.entries)
    for number in (59, 7):
        again = prognostics.take(made_test(number, friction=0.9), PARAMETERS, TEN_HOURS)
        assert again is not None
        assert plain(again) == plain(told[-1])
        assert "in the history already" in again.events[0]
    assert len(prognostics.history.entries) == entries


def test_other_duty_is_answered_without_changing_anything(worn):
    prognostics, told = worn
    twice = prognostics.outlook(PARAMETERS, duty_of(TEN_HOURS, 2.0))
    now = told[-1]
    assert twice.duty == 2.0
    assert twice.lives["friction"].hours_50 == pytest.approx(now.lives["friction"].hours_50 / 2)
    assert twice.lives["free_play"].hours_50 == pytest.approx(
        now.lives["free_play"].hours_50 / 2, rel=0.05
    )
    assert "2 times as fast" in twice.assumption
    assert plain(prognostics.outlook(PARAMETERS, TEN_HOURS)) == plain(now)


@pytest.mark.parametrize("duty", [0.0, -1.0, math.nan, math.inf, 1e9])
def test_impossible_duty_is_refused_by_name_and_range(duty: float):
    with pytest.raises(ValueError, match=r"duty = .*\[0.001, 1000\]"):
        duty_of(TEN_HOURS, duty)


def test_without_history_there_is_no_answer():
    with pytest.raises(ValueError, match="no history yet"):
        Prognostics(History(*UNIT)).outlook(PARAMETERS, TEN_HOURS)


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


def test_stamps_that_go_back_are_told():
    prognostics, _ = lived(3)
    back = prognostics.take(made_test(-5), PARAMETERS, TEN_HOURS)
    assert back is not None
    assert any("70 s before" in event for event in back.events)
    assert back.hours == 40.0


def test_missed_tests_count_and_are_told():
    _, told = lived(20, missing=(7, 8, 12))
    events = {item.hours: item.events for item in told if item.events}
    assert any("2 without a valid estimate" in event for event in events[100.0])
    assert any("1 without a valid estimate" in event for event in events[140.0])
    assert (told[-1].hours, told[-1].cycles, told[-1].hours_per_cycle) == (200.0, 20, 10.0)


def test_step_is_a_warning_at_once_and_an_error_when_it_is_confirmed():
    prognostics, _ = lived(20)
    told = [
        prognostics.take(made_test(n, friction=0.7, backlash=backlash(n)), PARAMETERS, TEN_HOURS)
        for n in (20, 21)
    ]
    healths = [
        next(item for item in outlook.health.faults if item.name == "friction")
        for outlook in told
        if outlook
    ]
    first, second = (outlook.events for outlook in told if outlook)
    assert first[0].startswith("outlier: friction 0.700")
    assert (healths[0].level, healths[0].value < 0.1) == (WARN, True)
    assert any(event.startswith("step: friction") for event in second)
    assert healths[1].level == ERROR
    assert healths[1].value == pytest.approx(0.7, abs=0.02)


def test_limit_that_changes_counts_from_then_on_for_the_whole_history(worn):
    settings = replace(TEN_HOURS, limits=HealthLimits(friction=0.9))
    _, expected = lived(20, settings)
    prognostics, _ = lived(20)
    assert plain(prognostics.outlook(PARAMETERS, settings)) == plain(expected[-1])


def test_requirement_that_a_healthy_actuator_misses_is_told():
    settings = replace(TEN_HOURS, requirements=RequirementLimits(bandwidth=60.0))
    _, told = lived(2, settings)
    assert told[-1].health.requirements == ()
    assert "misses the limit of 60 Hz" in told[-1].rul_requirements.reason


def test_set_aside_history_is_told_with_the_first_test(tmp_path: Path):
    path = tmp_path / "history.jsonl"
    path.write_text("nothing\n")
    prognostics, told = lived(2, path=path)
    prognostics.history.close()
    assert "set aside" in told[0].events[0]
    assert told[1].events == ()


def test_a_test_takes_a_fraction_of_its_identification(worn):
    """Median of what follows from a test, on top of the update of the tracker."""
    prognostics, _ = worn
    times = []
    for _ in range(7):
        start = time.perf_counter()
        prognostics.outlook(PARAMETERS, TEN_HOURS)
        times.append(time.perf_counter() - start)
    assert np.median(times) < 0.25


def test_requirements_of_a_unit_are_made_once():
    assert requirements_of(PARAMETERS, RequirementLimits()) is requirements_of(
        ActuatorParameters(), RequirementLimits()
    )


class OfWideGain(Tracker):
    """A tracker whose futures of the gain, which it does not know to grow, go anywhere."""

    def futures(self, hours: ArrayLike, n: int = 500, duty: float = 1.0) -> NDArray[np.float64]:
        paths = super().futures(hours, n, duty)
        paths[1:, :, -1] = np.linspace(0.0, 1.0, n)
        return paths


def test_what_is_not_known_to_grow_ends_no_life(worn, monkeypatch: pytest.MonkeyPatch):
    expected = worn[0].outlook(PARAMETERS, TEN_HOURS)
    monkeypatch.setattr(prognostics_module, "Tracker", OfWideGain)
    told = lived(60)[1][-1]
    assert told.rul_requirements == expected.rul_requirements
    assert told.lives == expected.lives


def test_first_test_alone_ends_no_life():
    """However bad: it may be an outlier, and the tracker waits for a second one that agrees."""
    prognostics = Prognostics(History(*UNIT), TEN_HOURS)
    told = prognostics.take(made_test(0, backlash=0.4), PARAMETERS, TEN_HOURS)
    assert told is not None
    assert not told.rul_requirements.known
    assert "no test to rely on" in told.rul_requirements.reason


def test_earlier_of_two_lives():
    one = Life(True, 10.0, 50.0, 90.0, "one")
    other = Life(True, 20.0, 40.0, 95.0, "other")
    unknown = Life.unknown("none", "no growth")
    assert earlier(one, other) == Life(True, 10.0, 40.0, 90.0, "other")
    assert earlier(one, unknown) == earlier(unknown, one) == one
    assert earlier(unknown, Life.unknown("x", "too far")).reason == "no growth; too far"


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
    usage.tell(Count(1, 200.0, 25))
    usage.pass_test()
    assert usage.at(2, 7.0) == Age(200.0, 25)


def test_tests_count_for_hours_where_nobody_counts():
    usage = Usage(Age(100.0, 10))
    usage.pass_test()
    usage.pass_test()
    assert usage.at(2, 7.0) == Age(114.0, 12)


@pytest.mark.parametrize("hours", [-1.0, math.nan, math.inf])
def test_impossible_count_is_refused(hours: float):
    with pytest.raises(ValueError, match="flight_hours = "):
        Count(0, hours, 0)


def test_settings_of_the_tracker_change_what_it_tells():
    short = replace(TEN_HOURS, tracker=TrackerSettings(horizon_hours=50.0))
    _, told = lived(40, short)
    assert "horizon of 50 h" in told[-1].lives["friction"].reason
