"""What is published of one unit after its tests: from history, tracker, requirements and usage."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from ema_core.faults import FAULT_NAMES, fault_vector
from ema_core.levels import ERROR, OK, WARN
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis import growth_record
from ema_monitor.prognosis.duty.future import FutureDuty
from ema_monitor.prognosis.forecaster import earlier
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.requirements.requirements import (
    REQUIREMENTS,
    RequirementLimits,
    requirements_of,
)
from ema_monitor.prognosis.sentences import cause_of_level
from ema_monitor.prognosis.settings import duty_of
from ema_monitor.unit import Unit

from .lived_units import PARAMETERS, TEN_HOURS, UNIT, backlash, friction, lived, plain
from .made_tests import made_test


@pytest.fixture(scope="module")
def worn() -> tuple[Unit, list[Outlook]]:
    return lived(60)


@pytest.mark.slow
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
    assert last.rul.criterion == last.rul_requirements.criterion == "torque margin falls below 0.5"
    assert last.dominant == "torque_margin"


def test_trends_are_those_of_the_laws(worn):
    trends = worn[1][-1].trends
    assert trends["friction"] == pytest.approx(0.003 * (friction(59) + 0.05), rel=0.25)
    assert trends["backlash"] == pytest.approx(6e-4, rel=0.25)
    # BLK (1 + 99 k_2) tau
    assert trends["free_play"] == pytest.approx(1e-5 * 99 * trends["backlash"], rel=1e-6)
    # The model along the growth of friction and backlash, far enough to even out that the peak of
    # the torque jumps from one turn of the motor to the next: 8 % in itself.
    now = fault_vector({item.name: item.value for item in worn[1][-1].health.faults})
    growth = np.array([trends.get(name, 0.0) for name in FAULT_NAMES])
    growth *= [name in ("friction", "backlash") for name in FAULT_NAMES]
    requirements = requirements_of(PARAMETERS, RequirementLimits())
    assert not isinstance(requirements, str)
    before, after = requirements.model.performance([now - 60 * growth, now + 60 * growth])[-1]
    assert trends["torque_margin"] == pytest.approx((after - before) / 120.0, rel=0.15)


def test_health_is_that_of_the_tracked_values(worn):
    prognostics, outlooks = worn
    last = outlooks[-1]
    [item] = [item for item in last.health.faults if item.name == "friction"]
    single = prognostics.history.entries[-1].estimate
    assert item.value != single.faults[0]
    assert item.value == pytest.approx(friction(59), abs=0.006)
    assert item.sigma < 0.004
    assert item.level == WARN
    assert last.health.health_index == pytest.approx(1.0 - max(i.share for i in last.health.faults))
    assert [i.name for i in last.health.requirements] == list(REQUIREMENTS)


def test_healthy_actuator_is_told_no_life_and_no_alarm():
    """Of errors that a false alarm could be made of."""
    prognostics = Unit(History(*UNIT), TEN_HOURS)
    for number in range(30):
        estimate = made_test(number, seed=11, friction=0.0, backlash=0.0, gain=0.5)
        last = prognostics.update(estimate, PARAMETERS, TEN_HOURS)
        assert last is not None
        assert (last.health.level, last.rul.known, last.dominant) == (OK, False, "")
        assert last.rul.reason


def test_same_test_again_changes_nothing_and_a_different_one_at_its_time_is_told(worn):
    prognostics, outlooks = worn
    entries = len(prognostics.history.entries)
    same = prognostics.history.entries[59].estimate
    for test, words in (
        (same, "in the history already"),
        (made_test(59, friction=0.9), "its stamp must show which came first"),
        (made_test(7, friction=0.9), ""),  # each once after a test
    ):
        again = prognostics.update(test, PARAMETERS, TEN_HOURS)
        assert again is not None
        assert plain(again) == plain(outlooks[-1])
        assert [words in event.text for event in again.events] == [True] * bool(words)
    assert len(prognostics.history.entries) == entries


def test_other_duty_is_answered_without_changing_anything(worn):
    prognostics, outlooks = worn
    twice = prognostics.outlook(PARAMETERS, duty_of(TEN_HOURS, 2.0))
    now = outlooks[-1]
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
        Unit(History(*UNIT)).outlook(PARAMETERS, TEN_HOURS)


def test_test_that_comes_late_is_told_and_changes_no_level():
    prognostics, before = lived(3)
    back = prognostics.update(made_test(-5), PARAMETERS, TEN_HOURS)
    assert back is not None
    assert any("70 s older than the latest one" in event.text for event in back.events)
    assert (back.hours, back.claim, back.health.level) == (
        before[-1].hours, before[-1].claim, before[-1].health.level,
    )  # fmt: skip
    assert [test.entry.stamp_ns for test in prognostics.latest_tests(9)[0]] == sorted(
        test.entry.stamp_ns for test in prognostics.latest_tests(9)[0]
    )


def test_step_is_a_warning_at_once_and_an_error_when_it_is_confirmed():
    prognostics, _ = lived(20)
    outlooks = [
        prognostics.update(made_test(n, friction=0.7, backlash=backlash(n)), PARAMETERS, TEN_HOURS)
        for n in (20, 21)
    ]
    healths = [
        next(item for item in outlook.health.faults if item.name == "friction")
        for outlook in outlooks
        if outlook
    ]
    first, second = (outlook.events for outlook in outlooks if outlook)
    assert str(first[0]).startswith("outlier: friction 0.700")
    assert (healths[0].level, healths[0].value < 0.1) == (WARN, True)
    assert any(str(event).startswith("step: friction") for event in second)
    assert healths[1].level == ERROR
    assert healths[1].value == pytest.approx(0.7, abs=0.02)


@pytest.mark.slow
def test_limit_that_changes_counts_from_then_on_for_the_whole_history(worn):
    settings = replace(TEN_HOURS, limits=HealthLimits(friction=0.9))
    _, expected = lived(20, settings)
    prognostics, _ = lived(20)
    assert plain(prognostics.outlook(PARAMETERS, settings)) == plain(expected[-1])


def test_requirement_that_a_healthy_actuator_misses_is_told():
    settings = replace(TEN_HOURS, requirements=RequirementLimits(bandwidth=60.0))
    _, outlooks = lived(2, settings)
    assert outlooks[-1].health.requirements == ()
    assert "misses the limit of 60 Hz" in outlooks[-1].rul_requirements.reason
    assert outlooks[-1].lives["bandwidth"].criterion == "bandwidth falls below 60 Hz"
    above = "tracking error exceeds the healthy actuator's by more than 0.0015 rad"
    assert outlooks[-1].lives["tracking_error"].criterion == above


def test_criterion_is_the_same_be_its_life_known_or_not(worn):
    unknown, known = worn[1][0].lives, worn[1][-1].lives
    assert known["torque_margin"].known
    assert not unknown["torque_margin"].known
    for name in REQUIREMENTS:
        assert unknown[name].criterion == known[name].criterion
    assert known["bandwidth"].criterion == "bandwidth falls below 12 Hz"


def test_worst_requirement_with_a_warning_is_named_while_no_life_is_known():
    """The torque margin suffers from backlash that is well within its own limit."""
    prognostics = Unit(History(*UNIT), TEN_HOURS)
    estimates = [made_test(number, backlash=0.09) for number in range(3)]
    *_, last = [prognostics.update(one, PARAMETERS, TEN_HOURS) for one in estimates]
    assert last is not None
    assert not last.rul.known
    assert (last.health.level, last.dominant) == (WARN, "torque_margin")
    assert all(item.level == OK for item in last.health.faults)


def test_set_aside_history_is_told_with_the_first_test(tmp_path: Path):
    path = tmp_path / "history.sqlite"
    path.write_text("nothing\n")
    prognostics, outlooks = lived(2, path=path)
    prognostics.history.close()
    assert "set aside" in outlooks[0].events[0].text
    assert outlooks[1].events == ()


class OfWideGain(Tracker):
    """A tracker whose futures of the gain, which it does not know to grow, go anywhere."""

    def futures(
        self, hours: ArrayLike, n: int = 500, duty: FutureDuty | float = 1.0
    ) -> NDArray[np.float64]:
        paths = super().futures(hours, n, duty)
        paths[1:, :, -1] = np.linspace(0.0, 1.0, n)
        return paths


@pytest.mark.slow
def test_what_is_not_known_to_grow_ends_no_life(worn, monkeypatch: pytest.MonkeyPatch):
    expected = worn[0].outlook(PARAMETERS, TEN_HOURS)
    monkeypatch.setattr(growth_record, "Tracker", OfWideGain)
    outlook = lived(60)[1][-1]
    assert outlook.rul_requirements == expected.rul_requirements
    # Unknown lives hold NaN, which does not equal itself.
    assert repr(outlook.lives) == repr(expected.lives)


@pytest.mark.slow
@pytest.mark.parametrize("hidden", ["eccentricity", "backlash"])
def test_component_that_no_test_has_shown_ends_no_life(hidden: str):
    prognostics = Unit(History(*UNIT), TEN_HOURS)
    outlook = None
    number = FAULT_NAMES.index(hidden)
    for test in range(60):
        found = made_test(test, seed=3, friction=friction(test))
        covariance = found.covariance.copy()
        covariance[number], covariance[:, number] = np.nan, np.nan
        unobservable = found.unobservable.copy()
        unobservable[number] = True
        estimate = replace(found, covariance=covariance, unobservable=unobservable)
        outlook = prognostics.update(estimate, PARAMETERS, TEN_HOURS)
    assert outlook is not None
    assert outlook.rul_faults.known
    assert outlook.rul_requirements.reason == f"no test has shown {hidden} yet"
    assert outlook.rul == outlook.rul_faults


def test_first_test_alone_ends_no_life():
    """However bad: it may be an outlier, and the tracker waits for a second one that agrees."""
    prognostics = Unit(History(*UNIT), TEN_HOURS)
    outlook = prognostics.update(made_test(0, backlash=0.4), PARAMETERS, TEN_HOURS)
    assert outlook is not None
    assert not outlook.rul_requirements.known
    assert "fewer than two tests" in outlook.rul_requirements.reason


def test_earlier_of_two_lives():
    one = RemainingLife(True, 10.0, 50.0, 90.0, "one")
    other = RemainingLife(True, 20.0, 40.0, 95.0, "other")
    unknown = RemainingLife.unknown("none", "no growth")
    # Of lives that end independently, the first to end does so sooner than either.
    both = RemainingLife(True, 5.0, 30.0, 92.0, "any")
    assert earlier(one, other, both) == RemainingLife(True, 5.0, 30.0, 90.0, "other")
    assert earlier(one, other, unknown) == RemainingLife(True, 10.0, 40.0, 90.0, "other")
    assert earlier(one, unknown, unknown) == earlier(unknown, one, unknown) == one
    too_far = RemainingLife.unknown("x", "too far")
    assert earlier(unknown, too_far, unknown).reason == "no growth; too far"


def test_value_of_a_test_that_is_not_confirmed_is_told_and_not_the_one_before():
    prognostics, _ = lived(6)
    estimate = made_test(6, friction=0.797, backlash=backlash(6))
    outlook = prognostics.update(estimate, PARAMETERS, TEN_HOURS)
    assert outlook is not None
    words = cause_of_level(outlook)
    assert "friction 0.797 in the latest test, which the next one has to confirm" in words
