"""Metrics of prognosis against closed forms."""

import importlib
import math
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(BENCHMARKS))
    metrics = importlib.import_module("prognosis_metrics")
END = 1000.0
HOURS = np.arange(0.0, END, 10.0)
TRUTH = END - HOURS


def certain(rul):
    """Return a distribution without width about each prediction."""
    return np.tile(np.asarray(rul)[:, None], (1, 4))


def test_perfect_predictor_scores_one_everywhere():
    assert metrics.cumulative_relative_accuracy(HOURS, TRUTH, END) == 1.0
    assert metrics.accuracy_on_event_time(HOURS, TRUTH, END) == 1.0
    assert metrics.coverage(TRUTH, TRUTH, TRUTH) == 1.0
    assert np.all(metrics.cone_probability(HOURS, certain(TRUTH), END) == 1.0)
    in_band = metrics.horizon_probability(HOURS, certain(TRUTH), END)
    assert metrics.prognostic_horizon(HOURS, in_band, END) == END


def test_proportional_error_is_the_relative_accuracy():
    assert metrics.relative_accuracy(1.1 * TRUTH, TRUTH) == pytest.approx(0.9)
    assert metrics.relative_accuracy(0.7 * TRUTH, TRUTH) == pytest.approx(0.7)
    assert metrics.cumulative_relative_accuracy(HOURS, 1.1 * TRUTH, END, 0.0) == pytest.approx(0.9)


def test_relative_accuracy_has_no_lower_bound_and_is_zero_without_a_prediction():
    values = metrics.relative_accuracy([30.0, np.nan, np.inf], [10.0, 10.0, 10.0])
    assert values == pytest.approx([-1.0, 0.0, 0.0])


def test_relative_accuracy_at_a_share_is_that_of_the_prediction_then():
    # Exact until 600 h, half of the truth from then on: lambda 0.5 of 200 h to 1000 h is 600 h.
    rul = np.where(HOURS < 600.0, TRUTH, 0.5 * TRUTH)
    assert metrics.relative_accuracy_at(HOURS, rul, END, 0.49, 200.0) == 1.0
    assert metrics.relative_accuracy_at(HOURS, rul, END, 0.5, 200.0) == 0.5
    assert metrics.relative_accuracy_at(HOURS, rul, END, 0.5) == 1.0


def test_relative_accuracy_at_a_share_holds_the_latest_test_to_the_truth_when_it_was_made():
    # The test at 700 h is the latest up to 790 h; 300 h remained, 330 h were predicted.
    assert metrics.relative_accuracy_at([0.0, 700.0], [1.0, 330.0], END, 0.79) == pytest.approx(0.9)


def test_relative_accuracy_without_a_prediction_is_zero_at_any_share():
    assert metrics.relative_accuracy_at([500.0], [400.0], END, 0.4) == 0.0
    assert metrics.relative_accuracy_at([500.0], [np.nan], END, 0.6) == 0.0


def test_constant_bias_costs_the_mean_of_its_share():
    late = TRUTH[HOURS >= 500.0]
    expected = np.mean(1.0 - 20.0 / late)
    assert metrics.cumulative_relative_accuracy(HOURS, TRUTH + 20.0, END) == pytest.approx(expected)
    assert metrics.cumulative_relative_accuracy(HOURS, TRUTH - 20.0, END) == pytest.approx(expected)


def test_only_the_part_of_life_that_is_asked_for_counts():
    rul = np.where(HOURS < 500.0, 0.0, np.where(HOURS < 900.0, TRUTH, np.nan))
    assert metrics.cumulative_relative_accuracy(HOURS, rul, END, 0.5, 0.9) == 1.0
    assert metrics.cumulative_relative_accuracy(HOURS, rul, END, 0.0, 0.5) == 0.0
    assert metrics.cumulative_relative_accuracy(HOURS, rul, END) == pytest.approx(40 / 50)
    assert math.isnan(metrics.cumulative_relative_accuracy(HOURS, rul, END, 0.991, 0.999))


def test_accuracy_on_event_time_flatters():
    """Of no use at all late in life, and yet close to 1 on the time of the event."""
    late = HOURS >= 500.0
    useless = np.zeros(late.sum())
    on_event = metrics.accuracy_on_event_time(HOURS[late], useless, END)
    assert metrics.cumulative_relative_accuracy(HOURS[late], useless, END) == 0.0
    assert on_event == pytest.approx(np.mean(HOURS[late] / END))
    assert on_event > 0.7


def test_probability_within_counts_samples_on_the_bounds_and_none_that_are_infinite():
    samples = [[1.0, 2.0, 3.0, np.inf], [1.0, np.nan, np.inf, np.inf]]
    assert metrics.probability_within(samples, [1.0, 0.0], [2.0, np.inf]) == pytest.approx(
        [0.5, 0.25]
    )


def test_cone_narrows_and_band_does_not():
    samples = certain(TRUTH + 100.0)
    in_cone = metrics.cone_probability(HOURS, samples, END, 0.2)
    in_band = metrics.horizon_probability(HOURS, samples, END, 0.2)
    assert np.array_equal(in_cone == 1.0, TRUTH >= 500.0)
    assert np.all(in_band == 1.0)
    assert not np.any(metrics.horizon_probability(HOURS, samples, END, 0.099))


def test_cone_probability_is_that_of_the_distribution():
    spread = np.linspace(0.5, 1.5, 1001)
    samples = TRUTH[:, None] * spread
    # Uniform from half to one and a half times the truth: 0.4 of it within 20 %.
    assert metrics.cone_probability(HOURS, samples, END, 0.2) == pytest.approx(0.4, abs=2e-3)


def test_prognostic_horizon_begins_where_predictions_stay_good():
    probability = np.where(HOURS >= 600.0, 0.8, 0.1)
    assert metrics.prognostic_horizon(HOURS, probability, END) == 400.0
    probability[-3] = 0.4
    assert metrics.prognostic_horizon(HOURS, probability, END) == END - HOURS[-2]
    assert metrics.prognostic_horizon(HOURS, probability, END, beta=0.3) == 400.0
    assert metrics.prognostic_horizon(HOURS, np.zeros_like(HOURS), END) == 0.0
    probability[-1] = 0.0
    assert metrics.prognostic_horizon(HOURS, probability, END) == 0.0


def test_alpha_lambda_judges_the_latest_prediction_up_to_its_time():
    probability = np.where(HOURS < 755.0, 0.9, 0.2)
    good = metrics.alpha_lambda(HOURS, probability, END, 0.75)
    assert (good.passed, good.probability, good.hours) == (True, 0.9, 750.0)
    assert metrics.alpha_lambda(HOURS, probability, END, 0.759).hours == 750.0
    assert not metrics.alpha_lambda(HOURS, probability, END, 0.76).passed


def test_alpha_lambda_counts_from_the_first_prediction():
    probability = np.ones_like(HOURS)
    assert metrics.alpha_lambda(HOURS, probability, END, 0.5, first_hours=200.0).hours == 600.0


def test_alpha_lambda_fails_without_a_prediction():
    none = metrics.alpha_lambda(HOURS[50:], np.ones(50), END, 0.25)
    assert (none.passed, none.probability) == (False, 0.0)
    assert math.isnan(none.hours)


def test_beta_itself_is_enough():
    half = np.full_like(HOURS, 0.5)
    assert metrics.alpha_lambda(HOURS, half, END, 0.5).passed
    assert metrics.prognostic_horizon(HOURS, half, END) == END


def test_convergence_of_a_constant_error_is_the_centre_of_a_rectangle():
    # From t_P = 100 h to 990 h, 40 h high.
    hours = HOURS[10:]
    expected = math.hypot((990.0 - 100.0) / 2.0, 20.0)
    assert metrics.convergence(hours, np.full_like(hours, 40.0), 100.0) == pytest.approx(expected)


def test_convergence_of_a_linear_error_is_the_centre_of_a_triangle():
    hours = np.linspace(0.0, 900.0, 90_001)
    error = 60.0 * (1.0 - hours / 900.0)
    assert metrics.convergence(hours, error, 0.0) == pytest.approx(
        math.hypot(300.0, 20.0), rel=1e-4
    )


def test_error_that_goes_sooner_converges_sooner():
    slow, fast = (metrics.convergence(HOURS, np.exp(-HOURS / tau), 0.0) for tau in (300.0, 100.0))
    assert fast < slow


def test_convergence_needs_an_error():
    assert math.isnan(metrics.convergence(HOURS, np.zeros_like(HOURS), 0.0))
    assert math.isnan(metrics.convergence([100.0], [5.0], 100.0))


def test_coverage_is_the_share_of_intervals_that_hold_the_truth():
    low, high = np.array([1.0, 2.0, 3.0, np.nan]), np.array([2.0, 3.0, 4.0, np.nan])
    assert metrics.coverage(low, high, 2.0) == pytest.approx(2 / 3)
    assert math.isnan(metrics.coverage([np.nan], [np.nan], [1.0]))
