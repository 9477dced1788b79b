# SPDX-License-Identifier: Apache-2.0
"""Robust regression agrees with closed forms, and its covariance with the actual errors."""

import numpy as np
import pytest

from ema_monitor.joint.regression import CoefficientPrior, regress, robust_fit

OPEN = CoefficientPrior(np.zeros(3), np.full(3, 1e3))
TRUTH = np.array([1.0, 0.5, -0.2])
EACH = 25
"""Number of rows in a stroke."""


def drawn(seed: int, strokes: int, shared: float, noise: float = 0.1):
    """Return rows in strokes back and forth, with an error per stroke and an error per row."""
    rng = np.random.default_rng(seed)
    clusters = np.repeat(np.arange(strokes), EACH)
    way = np.where(clusters % 2, -1.0, 1.0)
    speed = way * (1.5 + np.sin(np.tile(np.linspace(0.0, np.pi, EACH), strokes)))
    design = np.column_stack([way, speed, np.ones(len(way))])
    errors = shared * rng.standard_normal(strokes)[clusters]
    errors = errors + noise * rng.standard_normal(len(way))
    return design, design @ TRUTH + errors, clusters


def test_rows_without_error_give_the_exact_truth():
    design, target, clusters = drawn(0, 10, shared=0.0, noise=0.0)
    np.testing.assert_allclose(regress(design, target, clusters, OPEN).values, TRUTH, rtol=1e-9)


def test_fit_with_normal_errors_is_nearly_least_squares():
    design, target, _ = drawn(1, 40, shared=0.0)
    plain = np.linalg.lstsq(design, target, rcond=None)[0]
    sigmas = 0.1 * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    # Huber's weights with 2.5 standard deviations cost 1 % of the efficiency, so that the estimates
    # differ by a tenth of a standard error.
    assert np.all(np.abs(robust_fit(design, target, OPEN).values - plain) < 0.3 * sigmas)


def test_one_percent_of_outliers_moves_the_fit_by_less_than_its_error():
    design, target, clusters = drawn(2, 40, shared=0.0)
    clean = regress(design, target, clusters, OPEN)
    wrong = np.random.default_rng(3).choice(len(target), len(target) // 100, replace=False)
    target[wrong] += 20.0
    fouled = regress(design, target, clusters, OPEN).values
    plain = np.linalg.lstsq(design, target, rcond=None)[0]
    sigmas = np.sqrt(np.diag(clean.covariance))
    # Each outlier counts as 2.5 standard deviations: 1 % of the rows moves the mean by 0.025
    # standard deviations; a standard error of 1,000 rows is 0.03.
    assert np.all(np.abs(fouled - clean.values) < 2.0 * sigmas)
    # Least squares is off by 20 A / 100 = 0.2 A.
    assert np.max(np.abs(plain - TRUTH)) > 0.1


def test_prior_determines_what_the_rows_leave_open():
    design, target, clusters = drawn(4, 10, shared=0.0)
    design[:, 1] = 0.0
    fit = regress(
        design, target, clusters, CoefficientPrior(np.array([0.0, 0.7, 0.0]), np.full(3, 2.0))
    )
    assert fit.values[1] == pytest.approx(0.7)
    assert np.sqrt(fit.covariance[1, 1]) == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_covariance_is_in_no_direction_below_white_noise(seed):
    rng = np.random.default_rng(seed)
    design, target, clusters = drawn(seed, 6, shared=float(rng.uniform(0.0, 0.2)))
    fit = regress(design, target, clusters, OPEN)
    weights = robust_fit(design, target, OPEN).weights
    variance = float(weights @ fit.residuals**2) / (len(target) - 3)
    white = variance * np.linalg.inv(design.T @ (weights[:, None] * design))
    directions = rng.standard_normal((100, 3))
    ratio = np.einsum("di,ij,dj->d", directions, fit.covariance, directions)
    ratio /= np.einsum("di,ij,dj->d", directions, white, directions)
    # The prior of 1000 reduces the variance by 1e-9.
    assert np.min(ratio) > 1.0 - 1e-6


@pytest.mark.parametrize("shared", [0.0, 0.05, 0.2])
def test_intervals_are_valid_if_errors_are_correlated_within_strokes(shared):
    covered = np.zeros(3)
    for seed in range(300):
        design, target, clusters = drawn(100 + seed, 20, shared)
        fit = regress(design, target, clusters, OPEN)
        missed = np.abs(fit.values - TRUTH) / np.sqrt(np.diag(fit.covariance))
        covered += missed < 1.645
    # 90 % of 300 has a standard deviation of 1.7 %. 20 strokes give 17 degrees of freedom, with
    # which a normal 90 % interval covers 88 %, and the sandwich estimator is biased low by
    # leverage.
    assert np.all(covered / 300.0 > 0.83)
    # The speed changes within strokes: errors common to a stroke do not affect its coefficient, and
    # the floor of white noise makes its interval wide. The constant is known as well as the strokes
    # allow.
    assert covered[2] / 300.0 < 0.96


def test_independent_rows_would_give_too_narrow_intervals():
    """With a cluster per row, correlated errors are mistaken for white noise."""
    covered = 0
    for seed in range(100):
        design, target, _ = drawn(100 + seed, 20, shared=0.2)
        fit = regress(design, target, np.arange(len(target)), OPEN)
        covered += abs(fit.values[2] - TRUTH[2]) < 1.645 * np.sqrt(fit.covariance[2, 2])
    # Errors of 0.2 A common to 25 rows and 0.1 A of each row: the standard error of the mean is
    # sqrt((0.2^2 + 0.1^2 / 25) / (0.2^2 + 0.1^2) * 25) = 4.5 times as large as for
    # independent rows, and the interval covers 28 %.
    assert covered < 45
