"""What is to come after a test, which later tests do not change."""

import math

import numpy as np
import pytest

from ema_monitor.prognosis.forecaster import LEVELS, hours_ahead
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .made_tests import made_test

SETTINGS = PrognosisSettings(service=Service(hours_per_cycle=10.0))


def grown(tests: int, settings: PrognosisSettings = SETTINGS):
    """A unit whose friction grows by 0.01 a test, and the outlook after its latest test."""
    unit = Unit(History("flap", "0001"), settings)
    outlook = None
    for number in range(tests):
        estimate = made_test(number, seed=1, friction=0.05 + 0.01 * number)
        outlook = unit.update(estimate, None, settings)
    assert outlook is not None
    return unit, outlook


def test_fan_begins_at_the_tracked_value_and_passes_the_limit_about_the_median_life():
    unit, outlook = grown(30)
    forecaster = unit.forecaster(outlook)
    assert forecaster is not None
    fan = forecaster.fan()
    assert fan is not None
    assert tuple(fan.levels) == LEVELS
    [now] = [item.value for item in outlook.health.faults if item.name == "friction"]
    _, median, _ = fan.values["friction"]
    assert median[0] == pytest.approx(now, abs=0.005)
    passes = np.interp(forecaster.limits.of("friction"), median, fan.hours)
    # Median of the passages and passage of the median differ by a few percent at most.
    assert passes == pytest.approx(outlook.rul.hours_50, rel=0.1)
    assert fan.hours[-1] > outlook.rul.hours_50


def test_forecaster_does_not_change_with_later_tests():
    unit, outlook = grown(20)
    kept, twin = unit.forecaster(outlook), unit.forecaster(outlook)
    assert kept is not None
    assert twin is not None
    before = twin.fan()
    for number in range(20, 25):
        unit.update(made_test(number, seed=1, friction=0.4), None, SETTINGS)
    after = kept.fan()
    assert before is not None
    assert after is not None
    for name, values in before.values.items():
        np.testing.assert_array_equal(values, after.values[name])
    # What was asked for too late is of another test.
    assert unit.forecaster(outlook) is None


def test_without_service_hours_there_is_no_fan():
    unit, outlook = grown(10, PrognosisSettings())
    forecaster = unit.forecaster(outlook)
    assert forecaster is not None
    assert forecaster.fan() is None


def test_axis_reaches_behind_the_likely_end_of_life_but_not_far_beyond_what_was_observed():
    life = RemainingLife(True, 80.0, 100.0, 130.0, "")
    assert hours_ahead(life, 500.0) == pytest.approx(143.0)
    assert hours_ahead(life, 50.0) == pytest.approx(100.0)
    assert hours_ahead(RemainingLife(True, 80.0, 100.0, math.inf, ""), 500.0) == 250.0
    assert hours_ahead(RemainingLife.unknown("", ""), 500.0) == pytest.approx(30.0)
