"""Growth that keeps to no law: errors that last, waves, and rates that change."""

import numpy as np
import pytest

from ema_monitor.prognosis.growth import wander
from ema_monitor.prognosis.growth.errors import EstimateErrors
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.tracker import Tracker

from .tracked_lives import SIGMA, observed, of

ALL = np.ones(7, dtype=bool)


@pytest.mark.parametrize("correlation", [0.0, 0.5])
@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_size_and_correlation_of_errors_are_learnt(correlation, factor):
    rng = np.random.default_rng(0)
    errors, noise = EstimateErrors(TrackerSettings()), np.full(7, SIGMA**2)
    error = rng.standard_normal(7)
    for test in range(80):
        errors.advance(np.full(7, 10.0))
        errors.observed(0.1 + 2e-3 * test + factor * SIGMA * error, noise, ALL, ~ALL)
        error = correlation * error + np.sqrt(1.0 - correlation**2) * rng.standard_normal(7)
    # Seven components by 80 tests: less than a step of the grid.
    assert errors.correlation == pytest.approx(correlation, abs=0.15)
    assert errors.factor == pytest.approx(factor, rel=0.25)


def test_transitions_keep_the_stationary_probabilities_of_the_pace():
    for hours in (1.0, 50.0, 1e4):
        step = wander.transition(hours)
        np.testing.assert_allclose(step.sum(axis=1), 1.0, atol=1e-12)
        np.testing.assert_allclose(wander.SHARES @ step, wander.SHARES, atol=1e-12)
    np.testing.assert_allclose(wander.transition(1e5), np.tile(wander.SHARES, (7, 1)), atol=1e-9)


def test_pace_forgets_itself_within_its_hours():
    step = wander.transition(wander.WANDER_HOURS)
    mean = step @ wander.PACES
    # That of the process is exp(-1); on the grid the outermost paces are held back.
    np.testing.assert_allclose(mean[2:5], np.exp(-1.0) * wander.PACES[2:5], atol=0.05)


def test_time_at_a_lasting_pace_is_shorter_by_it():
    own, rng = np.full(200, 5.0), np.random.default_rng(0)
    hours = wander.hours_of(own, np.full(200, wander.LOG_MEAN + np.log(2.0)), rng)
    # Over 1 % of the hours within which it forgets itself a pace changes by 0.07.
    assert np.median(hours) == pytest.approx(2.5, rel=0.1)


@pytest.mark.slow
def test_wave_in_a_constant_fault_is_not_taken_for_growth():
    tracker, rng = Tracker(), np.random.default_rng(1)
    for test in range(100):
        value = 0.2 + 0.02 * np.sin(2.0 * np.pi * 12.0 * test / 500.0)
        tracker.update(observed(12.0 * test, {"friction": value}, rng))
        assert not tracker.predict().overall.known


@pytest.mark.slow
def test_line_under_a_wave_is_predicted_as_the_line():
    tracker, rng = Tracker(), np.random.default_rng(2)
    for test in range(70):
        hours = 12.0 * test
        value = 0.05 + 4e-4 * hours + 0.02 * np.sin(2.0 * np.pi * hours / 400.0)
        tracker.update(observed(hours, {"friction": value}, rng))
    # The end by level and wave, 0.02 before or behind that of the line.
    truth = (0.45 / 4e-4) - tracker.hours
    assert tracker.predict().overall.hours_50 == pytest.approx(truth, abs=0.025 / 4e-4)


@pytest.mark.slow
def test_rate_that_doubles_is_followed_in_some_tests():
    tracker, rng = Tracker(), np.random.default_rng(3)
    value = 0.0
    for test in range(90):
        value += 12.0 * (2e-4 if test < 60 else 6e-4)
        tracker.update(observed(12.0 * test, {"friction": value}, rng))
    assert of(tracker, "friction").trend == pytest.approx(6e-4, rel=0.25)
