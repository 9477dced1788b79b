# SPDX-License-Identifier: Apache-2.0
"""Metrics of prognosis compared with closed forms."""

import math

import numpy as np
import pytest

from ..benchmarks import benchmark

metrics = benchmark("prognosis.metrics")
END = 1000.0
HOURS = np.arange(0.0, END, 10.0)
TRUTH = END - HOURS


def certain(rul):
    """Return a distribution without width at each prediction."""
    return np.tile(np.asarray(rul)[:, None], (1, 4))


def test_perfect_predictor_scores_one_everywhere():
    assert metrics.cumulative_relative_accuracy(HOURS, TRUTH, END) == 1.0
    assert metrics.accuracy_on_event_time(HOURS, TRUTH, END) == 1.0
    assert np.all(metrics.cone_probability(HOURS, certain(TRUTH), END) == 1.0)
    in_band = metrics.horizon_probability(HOURS, certain(TRUTH), END)
    assert metrics.prognostic_horizon(HOURS, in_band, END) == END


def test_relative_accuracy_has_no_lower_bound_and_is_zero_without_a_prediction():
    values = metrics.relative_accuracy([30.0, np.nan, np.inf], [10.0, 10.0, 10.0])
    assert values == pytest.approx([-1.0, 0.0, 0.0])


def test_cumulative_accuracy_is_the_mean_over_the_requested_part_of_life():
    late = TRUTH[HOURS >= 500.0]
    expected = np.mean(1.0 - 20.0 / late)
    assert metrics.cumulative_relative_accuracy(HOURS, TRUTH + 20.0, END) == pytest.approx(expected)
    rul = np.where(HOURS < 500.0, 0.0, np.where(HOURS < 900.0, TRUTH, np.nan))
    assert metrics.cumulative_relative_accuracy(HOURS, rul, END) == pytest.approx(40 / 50)
    assert math.isnan(metrics.cumulative_relative_accuracy(HOURS, rul, END, 0.991))


def test_accuracy_on_event_time_is_too_favourable():
    """A prediction that is useless late in life scores close to 1 on the time of the event."""
    late = HOURS >= 500.0
    useless = np.zeros(late.sum())
    on_event = metrics.accuracy_on_event_time(HOURS[late], useless, END)
    assert metrics.cumulative_relative_accuracy(HOURS[late], useless, END) == 0.0
    assert on_event == pytest.approx(np.mean(HOURS[late] / END))
    assert on_event > 0.7


def test_probability_within_includes_samples_on_the_bounds_and_no_infinite_ones():
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


def test_prognostic_horizon_begins_where_predictions_stay_good():
    probability = np.where(HOURS >= 600.0, metrics.BETA, 0.1)
    assert metrics.prognostic_horizon(HOURS, probability, END) == 400.0
    probability[-3] = 0.4
    assert metrics.prognostic_horizon(HOURS, probability, END) == END - HOURS[-2]
    probability[-1] = 0.0
    assert metrics.prognostic_horizon(HOURS, probability, END) == 0.0


def test_lambda_judges_the_latest_prediction_up_to_its_time():
    probability = np.where(HOURS < 755.0, 0.9, 0.2)
    assert metrics.at_lambda(HOURS, probability, END, 0.759) == 0.9
    assert metrics.at_lambda(HOURS, probability, END, 0.76) == 0.2
    # With a first prediction at 200 h, half of the remaining life is over at 600 h.
    assert metrics.at_lambda(HOURS, HOURS, END, 0.5, first_hours=200.0) == 600.0
    assert metrics.at_lambda(HOURS[50:], np.ones(50), END, 0.25) == 0.0


@pytest.mark.parametrize(
    ("error", "centre"),
    [
        (lambda hours: np.full_like(hours, 40.0), (450.0, 20.0)),
        (lambda hours: 60.0 * (1.0 - hours / 900.0), (300.0, 20.0)),
    ],
    ids=["rectangle", "triangle"],
)
def test_convergence_is_the_distance_to_the_centroid_of_the_area(error, centre):
    hours = np.linspace(0.0, 900.0, 90_001)
    convergence = metrics.convergence(hours + 100.0, error(hours), 100.0)
    assert convergence == pytest.approx(math.hypot(*centre), rel=1e-4)


def test_convergence_needs_an_error():
    assert math.isnan(metrics.convergence(HOURS, np.zeros_like(HOURS), 0.0))
    assert math.isnan(metrics.convergence([100.0], [5.0], 100.0))
