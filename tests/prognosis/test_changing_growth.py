# SPDX-License-Identifier: Apache-2.0
"""Growth that follows no law: waves, missed predictions, changing rates."""

import numpy as np
import pytest

from ema_core.faults import COMPONENTS
from ema_monitor.prognosis.growth import check, wander
from ema_monitor.prognosis.growth.check import PredictionCheck, widened, widened_lives
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import KnownLaw, TrackerSettings

from .tracked_lives import SIGMA, observed, of

ALL = np.ones(len(COMPONENTS), dtype=bool)
FRICTION = COMPONENTS.index("friction")
SETTINGS = TrackerSettings()


def test_transitions_keep_the_stationary_probabilities_of_the_pace():
    for hours in (1.0, 50.0, 1e4):
        step = wander.transition(hours)
        np.testing.assert_allclose(step.sum(axis=1), 1.0, atol=1e-12)
        np.testing.assert_allclose(wander.SHARES @ step, wander.SHARES, atol=1e-12)
    np.testing.assert_allclose(wander.transition(1e5), np.tile(wander.SHARES, (7, 1)), atol=1e-9)


def test_pace_decorrelates_within_its_hours():
    step = wander.transition(wander.WANDER_HOURS)
    mean = step @ wander.PACES
    # The correlation of the process is exp(-1); on the grid, the outermost paces are held back.
    np.testing.assert_allclose(mean[2:5], np.exp(-1.0) * wander.PACES[2:5], atol=0.05)


def test_time_at_a_lasting_pace_is_divided_by_the_pace():
    own_hours, rng = np.full(200, 5.0), np.random.default_rng(0)
    hours = wander.hours_of(own_hours, np.full(200, wander.LOG_MEAN + np.log(2.0)), rng)
    # Over 1 % of its correlation time, a pace changes by 0.07.
    assert np.median(hours) == pytest.approx(2.5, rel=0.1)


@pytest.mark.slow
def test_wave_in_a_constant_fault_is_not_mistaken_for_growth():
    tracker, rng = Tracker(), np.random.default_rng(1)
    for test in range(100):
        value = 0.2 + 0.02 * np.sin(2.0 * np.pi * 12.0 * test / 500.0)
        tracker.update(observed(12.0 * test, {"friction": value}, rng))
        assert not tracker.predict().overall.known


@pytest.mark.slow
def test_line_with_a_wave_is_predicted_like_the_line():
    tracker, rng = Tracker(), np.random.default_rng(2)
    for test in range(70):
        hours = 12.0 * test
        value = 0.05 + 4e-4 * hours + 0.02 * np.sin(2.0 * np.pi * hours / 400.0)
        tracker.update(observed(hours, {"friction": value}, rng))
    # The end from level and wave, with the wave 0.02 above or below the line.
    truth = (0.45 / 4e-4) - tracker.hours
    assert tracker.predict().overall.hours_50 == pytest.approx(truth, abs=0.025 / 4e-4)


def checked(factor: float, tests: int = 400, misses: int = 0) -> PredictionCheck:
    """Return a check of predictions with a sigma of 0.02, and errors of ``factor`` times that."""
    result, rng = PredictionCheck(TrackerSettings()), np.random.default_rng(0)
    for test in range(tests):
        # Each test has an independent error.
        value = 0.2 + factor * 0.02 * rng.standard_normal()
        shown = ALL & (not misses or test % misses != misses - 1)
        result.observe(observed(10.0 * test, {"friction": value}), shown)
        if result.is_due:
            ahead = result.hours_ahead(10.0 * test)
            samples = 0.2 + 0.02 * rng.standard_normal((ahead.size, len(COMPONENTS), 400))
            result.keep(np.full(len(COMPONENTS), 10.0 * test), ahead, samples, ALL, ALL)
    return result


# A quarter of 75 predictions, weighted towards the later ones, determines a spread to 15 %.
@pytest.mark.parametrize(("factor", "misses"), [(1.5, 0), (2.2, 0), (2.2, 10), (2.2, 19)])
def test_too_narrow_predictions_are_widened_by_the_right_factor(factor, misses):
    widening = checked(factor, misses=misses).of(FRICTION)
    assert widening.ahead == pytest.approx(factor, rel=0.3)
    assert widening.widening == pytest.approx(factor, rel=0.2)


def test_right_or_too_wide_predictions_are_unchanged():
    assert checked(1.0).of(FRICTION).widening == pytest.approx(1.0, abs=0.15)
    wide = checked(0.4).of(FRICTION)
    assert wide.ahead < 0.7
    assert wide.widening == 1.0


def test_prediction_is_dropped_after_a_gap_longer_than_its_range():
    tested = checked(1.0, tests=80)
    scores = tested.of(FRICTION).ahead
    assert np.isnan(checked(1.0, tests=check.AHEAD).of(FRICTION).ahead)
    for test in range(check.AHEAD):
        tested.observe(observed(1e5 + test, {"friction": 0.5}), ALL)
    assert tested.of(FRICTION).ahead == scores


def test_repaired_part_starts_without_scores():
    tested = checked(2.2)
    tested.restart(FRICTION, is_new=True)
    assert np.isnan(tested.of(FRICTION).ahead)
    assert tested.widening()[FRICTION] == pytest.approx(1.0)


def test_widening_keeps_the_median_and_spreads_the_other_quantiles():
    rng = np.random.default_rng(1)
    hours = np.exp(rng.standard_normal((2, 5001)))
    wide = widened_lives(hours, np.array([1.0, 2.0]))
    np.testing.assert_array_equal(wide[0], hours[0])
    # The logarithms of the ratios to the median double, also for the quantiles.
    before = np.log(np.quantile(hours[1], [0.05, 0.5, 0.95], method="inverted_cdf"))
    after = np.log(np.quantile(wide[1], [0.05, 0.5, 0.95], method="inverted_cdf"))
    assert after[1] == pytest.approx(before[1], abs=1e-12)
    np.testing.assert_allclose(after - after[1], 2.0 * (before - before[1]), atol=1e-12)
    values = rng.standard_normal((3, 2, 400))
    spread = widened(values, np.array([1.0, 1.5]))
    np.testing.assert_allclose(spread[:, 0], values[:, 0], atol=1e-15)
    np.testing.assert_allclose(spread.std(axis=2)[:, 1], 1.5 * values.std(axis=2)[:, 1], rtol=1e-12)


@pytest.mark.slow
def test_scores_of_calibrated_predictions_are_near_one():
    tracker, rng = Tracker(), np.random.default_rng(2)
    for test in range(90):
        tracker.update(observed(10.0 * test, {"friction": 0.05 + 4e-3 * test}, rng))
    scores = of(tracker, "friction").track_record
    # 90 scores with a forgetting factor of 0.98: the root mean square is known to 10 %. Without
    # noise, growth is predicted better than claimed, some tests ahead.
    assert scores.one_step == pytest.approx(1.0, abs=0.25)
    assert scores.ahead < 1.3
    assert 1.0 <= scores.widening < 1.2


@pytest.mark.slow
def test_errors_larger_than_claimed_show_in_the_scores():
    # With an unknown law, growth by jumps may explain the errors.
    settings = TrackerSettings(laws={"friction": KnownLaw("linear", 4e-4)})
    tracker, rng = Tracker(settings=settings), np.random.default_rng(3)
    for test in range(25):
        value = 0.05 + 4e-3 * test + 2.5 * SIGMA * rng.standard_normal()
        tracker.update(observed(10.0 * test, {"friction": value, "backlash": 0.2}, rng))
    assert of(tracker, "friction").track_record.one_step > 1.3


@pytest.mark.slow
def test_tracker_follows_a_rate_that_changes_at_once():
    tracker, rng, value = Tracker(), np.random.default_rng(5), 0.0
    for test in range(66):
        value += 10.0 * (2e-4 if test < 50 else 8e-4)
        events = tracker.update(observed(10.0 * test, {"friction": value}, rng))
        assert events == []
    # To the error of some fifteen tests.
    assert of(tracker, "friction").trend == pytest.approx(8e-4, rel=0.25)
    # The probability of growth is kept.
    assert tracker.predict().overall.known
