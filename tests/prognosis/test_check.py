"""Predictions held against the tests that came, and intervals that are widened for it."""

import numpy as np
import pytest

from ema_core.faults import COMPONENTS
from ema_monitor.prognosis.growth import check
from ema_monitor.prognosis.growth.check import PredictionCheck, widened, widened_lives
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.tracker import Tracker

from .tracked_lives import SIGMA, observed, of

ALL = np.ones(len(COMPONENTS), dtype=bool)
FRICTION = COMPONENTS.index("friction")


def checked(factor: float, tests: int = 400, misses: int = 0) -> PredictionCheck:
    """Return a check whose predictions, of a spread of 0.02, are missed by that times a factor."""
    result, rng = PredictionCheck(TrackerSettings()), np.random.default_rng(0)
    for test in range(tests):
        # Each test is off the predictions by an error of its own.
        value = 0.2 + factor * 0.02 * rng.standard_normal()
        shown = ALL & (not misses or test % misses != misses - 1)
        result.observe(observed(10.0 * test, {"friction": value}), shown, 1.0)
        if result.is_due:
            ahead = result.hours_ahead(10.0 * test)
            samples = 0.2 + 0.02 * rng.standard_normal((ahead.size, len(COMPONENTS), 400))
            result.keep(np.full(len(COMPONENTS), 10.0 * test), ahead, samples, ALL, ALL)
    return result


# A quarter of 75 predictions, of which the later ones count more, tell a spread to 15 %.
@pytest.mark.parametrize("factor", [1.5, 2.2])
def test_predictions_that_were_too_narrow_are_widened_as_they_should(factor):
    found = checked(factor).of(FRICTION)
    assert found.ahead == pytest.approx(factor, rel=0.3)
    assert found.widening == pytest.approx(factor, rel=0.2)


def test_predictions_that_were_right_or_too_wide_are_left():
    assert checked(1.0).of(FRICTION).widening == pytest.approx(1.0, abs=0.15)
    wide = checked(0.4).of(FRICTION)
    assert wide.ahead < 0.7
    assert wide.widening == 1.0


@pytest.mark.parametrize("misses", [10, 19])
def test_component_that_now_and_then_misses_a_test_is_checked_as_well(misses):
    found = checked(2.2, misses=misses).of(FRICTION)
    assert found.widening == pytest.approx(2.2, rel=0.2)


def test_nothing_is_said_before_predictions_are_due():
    found = checked(1.0, tests=check.AHEAD).of(FRICTION)
    assert np.isnan([found.one_step, found.ahead, found.widening]).all()


def test_prediction_after_a_gap_longer_than_it_reaches_is_dropped():
    one = checked(1.0, tests=80)
    scores = one.of(FRICTION).ahead
    assert np.isfinite(scores)
    for test in range(check.AHEAD):
        one.observe(observed(1e5 + test, {"friction": 0.5}), ALL, 1.0)
    assert one.of(FRICTION).ahead == scores


def test_repaired_part_begins_without_scores():
    one = checked(2.2)
    one.restart(FRICTION, is_new=True)
    assert np.isnan(one.of(FRICTION).ahead)
    assert one.widening()[FRICTION] == pytest.approx(1.0)


def test_widening_keeps_the_median_and_spreads_the_rest():
    rng = np.random.default_rng(1)
    hours = np.exp(rng.standard_normal((2, 5001)))
    wide = widened_lives(hours, np.array([1.0, 2.0]))
    np.testing.assert_array_equal(wide[0], hours[0])
    # The logarithms of the ratios to the median are twice as large, and so are those of quantiles.
    before = np.log(np.quantile(hours[1], [0.05, 0.5, 0.95], method="inverted_cdf"))
    after = np.log(np.quantile(wide[1], [0.05, 0.5, 0.95], method="inverted_cdf"))
    assert after[1] == pytest.approx(before[1], abs=1e-12)
    np.testing.assert_allclose(after - after[1], 2.0 * (before - before[1]), atol=1e-12)
    values = rng.standard_normal((3, 2, 400))
    spread = widened(values, np.array([1.0, 1.5]))
    np.testing.assert_allclose(spread[:, 0], values[:, 0], atol=1e-15)
    np.testing.assert_allclose(spread.std(axis=2)[:, 1], 1.5 * values.std(axis=2)[:, 1], rtol=1e-12)


@pytest.mark.slow
def test_scores_of_honest_predictions_are_near_one():
    tracker, rng = Tracker(), np.random.default_rng(2)
    for test in range(90):
        tracker.update(observed(10.0 * test, {"friction": 0.05 + 4e-3 * test}, rng))
    found = of(tracker, "friction").calibration
    # 90 scores that forget by 0.98: the root mean square is known to 10 %. Growth without noise is
    # better predicted than it claims, some tests ahead.
    assert found.one_step == pytest.approx(1.0, abs=0.25)
    assert found.ahead < 1.3
    assert 1.0 <= found.widening < 1.2


@pytest.mark.slow
def test_errors_larger_than_they_claim_show_in_the_scores():
    tracker, rng = Tracker(), np.random.default_rng(3)
    for test in range(25):
        value = 0.05 + 4e-3 * test + 2.5 * SIGMA * rng.standard_normal()
        tracker.update(observed(10.0 * test, {"friction": value, "backlash": 0.2}, rng))
    assert of(tracker, "friction").calibration.one_step > 1.3
