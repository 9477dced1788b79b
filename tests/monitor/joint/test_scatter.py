# SPDX-License-Identifier: Apache-2.0
"""Predictions from healthy records follow the hierarchical model and have their stated power."""

import math
import statistics

import numpy as np
import pytest

from ema_monitor.joint.scatter import NODES, SPREAD, Prediction, Scatter

DAYS = [0, 0, 0, 1, 1, 5]
VALUES = np.array([1.01, 0.99, 1.0, 1.03, 1.035, 0.98])
VARIANCES = np.array([1e-4, 2e-4, 1e-4, 1e-4, 3e-4, 1e-4])
RECORDS, BETWEEN = 0.006, 0.01
"""Prior medians of the scatter of records and of days."""


def twin(nodes, values, variances, days, test, row=0.0, covariates=None):
    """Return weights, means and variances of the mixture, computed with full matrices.

    ``test`` is the day of the record to predict and the variance of its error. The mean is
    integrated out, and so are the slopes, whose prior is 30 times the larger scatter.
    """
    n = len(values)
    design = np.ones((n + 1, 1))
    if covariates is not None:
        design = np.column_stack([design, np.append(covariates, [row])])
    # The flat prior of the mean is a wide normal one.
    prior = np.diag([1e8] + [(30.0 * max(RECORDS, BETWEEN)) ** 2] * (design.shape[1] - 1))
    all_days, errors = [*days, test[0]], [*variances, test[1]]
    components = []
    for a in nodes:
        for b in nodes:
            record, day = RECORDS * math.exp(SPREAD * a), BETWEEN * math.exp(SPREAD * b)
            whole = design @ prior @ design.T
            for i in range(n + 1):
                for j in range(n + 1):
                    whole[i, j] += day**2 * (all_days[i] == all_days[j])
                whole[i, i] += record**2 + errors[i]
            inner, cross = whole[:n, :n], whole[:n, n]
            centred = np.asarray(values) - np.mean(values)
            solved = np.linalg.solve(inner, centred)
            log = -0.5 * (centred @ solved + np.linalg.slogdet(inner)[1] + a**2 + b**2)
            mean = np.mean(values) + cross @ solved
            variance = whole[n, n] - cross @ np.linalg.solve(inner, cross)
            components.append((log, mean, variance))
    logs, means, spreads = np.array(components).T
    weights = np.exp(logs - np.max(logs))
    return weights / np.sum(weights), means, spreads


def scatter(values=VALUES, variances=VARIANCES, days=DAYS, covariates=None) -> Scatter:
    return Scatter(np.asarray(values), np.asarray(variances), days, RECORDS, BETWEEN, covariates)


@pytest.mark.parametrize("day", [None, 1, 5, 77])
def test_prediction_agrees_with_full_covariance_matrices_on_the_same_grid(day):
    nodes = np.linspace(-2.5, 2.5, NODES)
    weights, means, variances = twin(nodes, VALUES, VARIANCES, DAYS, (day, 2e-4))
    prediction = scatter().predict(2e-4, day)
    mean = float(weights @ means)
    # Weights below 1e-6 are left out, and a prior of 1e4 for the mean is nearly flat.
    assert prediction.mean == pytest.approx(mean, abs=1e-6)
    sigma = math.sqrt(float(weights @ (variances + (means - mean) ** 2)))
    assert prediction.sigma == pytest.approx(sigma, rel=1e-3)


def test_prediction_with_a_covariate_agrees_with_full_covariance_matrices():
    covariates = np.array([-0.6, -0.2, 0.1, 0.4, 0.3, 0.0])
    values = VALUES + 0.05 * covariates
    nodes = np.linspace(-2.5, 2.5, NODES)
    weights, means, variances = twin(
        nodes, values, VARIANCES, DAYS, (None, 1e-4), row=0.5, covariates=covariates
    )
    prediction = scatter(values, covariates=covariates[:, None]).predict(
        1e-4, None, np.array([0.5])
    )
    mean = float(weights @ means)
    assert prediction.mean == pytest.approx(mean, abs=1e-6)
    sigma = math.sqrt(float(weights @ (variances + (means - mean) ** 2)))
    assert prediction.sigma == pytest.approx(sigma, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("day", [None, 1])
def test_grid_of_scatters_is_fine_enough(day):
    weights, means, variances = twin(
        np.linspace(-4.0, 4.0, 41), VALUES, VARIANCES, DAYS, (day, 1e-4)
    )
    prediction = scatter().predict(1e-4, day)
    exact = Prediction(weights, means, variances, weights)
    # A grid to 2.5 standard deviations leaves out 1 % of the prior, which has the widest tails: 3 %
    # of the distance of a quantile exceeded by 0.05 % of the records.
    for share in (0.0005, 0.05, 0.5, 0.95, 0.9995):
        expected = exact.quantile(share)
        away = 0.03 * abs(expected - exact.mean) + 0.02 * exact.sigma
        assert prediction.quantile(share) == pytest.approx(expected, abs=away), share


def test_mixture_agrees_with_drawn_records():
    """Draw days and records from the posterior, and count."""
    prediction = scatter().predict(1e-4, None)
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(prediction.weights), 200_000, p=prediction.weights)
    drawn = prediction.means[chosen] + np.sqrt(prediction.variances[chosen]) * rng.standard_normal(
        200_000
    )
    for share in (0.05, 0.5, 0.95):
        # The standard error of a share of 200,000 draws is 0.1 %.
        assert np.mean(drawn < prediction.quantile(share)) == pytest.approx(share, abs=0.004)


@pytest.mark.parametrize("share", [1e-4, 0.0005, 0.05, 0.3, 0.5, 0.9, 0.9995])
def test_quantile_inverts_the_distribution(share):
    prediction = scatter().predict(1e-4, None)
    # A millionth of the bracket of 16 standard deviations, at the peak of the density.
    assert prediction.below(prediction.quantile(share)) == pytest.approx(share, abs=1e-5, rel=1e-3)


def test_probability_is_small_far_from_the_middle_and_one_in_it():
    prediction = scatter().predict(1e-4, None)
    assert prediction.probability(prediction.quantile(0.5)) == pytest.approx(1.0, abs=1e-4)
    assert prediction.probability(prediction.quantile(0.9995)) == pytest.approx(0.001, rel=1e-2)
    # Far out it is tiny but not 0: the distribution function keeps its lower tail.
    assert (
        prediction.probability(prediction.mean + 6.0 * float(np.sqrt(np.max(prediction.variances))))
        > 0.0
    )


def test_additional_days_narrow_the_prediction_and_records_of_one_day_hardly_do():
    rng = np.random.default_rng(2)
    per_day = [0.01 * rng.standard_normal() for _ in range(12)]
    many = [1.0 + per_day[day] + 0.006 * rng.standard_normal() for day in range(12)]

    def sigma(values, days):
        return scatter(values, np.full(len(values), 1e-6), days).predict(1e-6).sigma

    one_day = [1.0 + 0.006 * rng.standard_normal() for _ in range(12)]
    sigmas = [sigma(many[:days], range(days)) for days in (2, 4, 12)]
    assert sigmas == sorted(sigmas, reverse=True)
    # After twelve records of one day, the scatter between days is as unknown as before.
    assert sigma(one_day, [0] * 12) > 1.2 * sigmas[-1]


def test_record_of_a_day_with_healthy_records_is_predicted_better():
    same, separate = (scatter().predict(1e-4, day) for day in (0, 77))
    assert same.sigma < 0.95 * separate.sigma
    # And its prediction is near the records of its day: day 1 was high.
    assert scatter().predict(1e-4, 1).mean > separate.mean


def test_error_of_the_record_adds_to_the_variance():
    narrow, wide = (scatter().predict(variance) for variance in (1e-4, 1e-2))
    assert wide.sigma**2 - narrow.sigma**2 == pytest.approx(0.01 - 1e-4, rel=1e-6)


def test_large_errors_of_the_healthy_records_do_not_narrow_the_scatter():
    """Records without information leave the prior unchanged."""
    vague = scatter(np.zeros(6), np.full(6, 100.0)).variance
    squares = RECORDS**2 + BETWEEN**2
    # The mean square of a log-normal scatter truncated at 2.5 standard deviations.
    z = np.linspace(-2.5, 2.5, NODES)
    mean_square = np.average(np.exp(2.0 * SPREAD * z), weights=np.exp(-0.5 * z**2))
    assert vague == pytest.approx(squares * mean_square, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("significance", [1e-2, 1e-3])
@pytest.mark.parametrize("days", [2, 5])
def test_smallest_change_is_detected_with_the_stated_power(significance, days):
    """Simulate the whole model: scatters from their priors, healthy records, then a record."""
    rng = np.random.default_rng(days)
    detected, alarms, count = 0, 0, 500
    for _ in range(count):
        record = RECORDS * math.exp(SPREAD * rng.standard_normal())
        day = BETWEEN * math.exp(SPREAD * rng.standard_normal())
        of_day = day * rng.standard_normal(days + 1)
        numbers = np.repeat(np.arange(days), 3)
        error = 0.004
        values = of_day[numbers] + math.hypot(record, error) * rng.standard_normal(len(numbers))
        healthy = Scatter(
            values, np.full(len(values), error**2), numbers.tolist(), RECORDS, BETWEEN
        )
        prediction = healthy.predict(error**2, None)
        later = of_day[-1] + math.hypot(record, error) * rng.standard_normal()
        alarms += prediction.probability(later) < significance
        changed = later + prediction.smallest_change(significance, 0.9)
        detected += prediction.probability(changed) < significance
    # 90 % of 500 has a standard deviation of 1.3 %; truncating the priors at 2.5 standard
    # deviations costs less than 1 %.
    assert detected / count == pytest.approx(0.9, abs=0.04)
    # The rate of false alarms, with four standard deviations and the truncation of the priors.
    assert alarms / count < significance + 4.0 * math.sqrt(significance / count) + 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.4, 1.0, 2.0, 3.0, 5.0])
def test_smallest_change_is_detected_with_the_stated_power_for_any_scatter_between_days(ratio):
    """The days scatter by ``ratio`` times the median of the prior, and records by half of that."""
    rng = np.random.default_rng(8)
    day, error, detected = ratio * BETWEEN, 0.004, []
    numbers = [0, 0, 0, 1, 1, 1, 2, 2, 2]
    whole = math.sqrt(1.25 * day**2 + error**2)
    for _ in range(150):
        values = day * rng.standard_normal(3)[numbers]
        values += math.hypot(0.5 * day, error) * rng.standard_normal(9)
        prediction = scatter(values, np.full(9, error**2), numbers).predict(error**2)
        limit = prediction.quantile(0.9995)
        missed = limit - prediction.smallest_change(1e-3, 0.9)
        # The records belong to a unit whose mean is 0.
        detected.append(1.0 - statistics.NormalDist(0.0, whole).cdf(missed))
    # The information of three days varies by 20 % to 40 %: the mean of 150 has a standard error of
    # 1.5 %. The grid of scatters ends beyond five times the median.
    assert 0.86 < np.mean(detected) < 0.97


def test_normal_distribution_function_agrees_with_the_standard_library():
    standard = Prediction(np.ones(1), np.zeros(1), np.ones(1), np.ones(1))
    for x in (-30.0, -5.0, -0.3, 0.0, 2.0):
        assert standard.below(x) == pytest.approx(statistics.NormalDist().cdf(x), abs=1e-15)
    assert standard.below(-30.0) > 0.0


@pytest.mark.parametrize("ratio", [0.4, 1.0, 2.0, 4.0])
def test_interval_is_valid_for_any_scatter_between_days(ratio):
    """The days scatter by ``ratio`` times the median of the prior, and records by half of that."""
    rng = np.random.default_rng(9)
    day, error, held, count = ratio * BETWEEN, 0.002, 0, 300
    numbers = [0, 0, 0, 1, 1, 1, 2, 2, 2]
    for _ in range(count):
        values = day * rng.standard_normal(3)[numbers]
        values += math.hypot(0.5 * day, error) * rng.standard_normal(9)
        prediction = scatter(values, np.full(9, error**2), numbers).predict(error**2)
        low, high = prediction.interval((0.05, 0.95))
        later = math.hypot(math.hypot(day, 0.5 * day), error) * rng.standard_normal()
        held += low <= later <= high
    # The end of the grid of scatters bounds very small ones from below. 300 draws: 1.7 %.
    assert 0.85 < held / count < (0.96 if ratio >= 1.0 else 1.0)
