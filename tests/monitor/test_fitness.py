"""The weighted residuals and the cost that their squares add up to."""

import math

import numpy as np
import pytest

from ema_monitor.fitness import WEIGHTS, least_squares_weights, total_least_squares_weights

H = 1e-4


def total_least_squares(measured, modelled, h):
    """Section 6.2 of the thesis with the slope over its rms, sample by sample."""
    n = len(measured)
    slope = [
        (measured[min(i + 1, n - 1)] - measured[max(i - 1, 0)])
        / (h * (min(i + 1, n - 1) - max(i - 1, 0)))
        for i in range(n)
    ]
    root_mean_square = math.sqrt(sum(s * s for s in slope) / n)
    return h * sum(
        (measured[i] - modelled[i]) ** 2 / math.sqrt((slope[i] / root_mean_square) ** 2 + 1)
        for i in range(n)
    )


@pytest.fixture
def currents():
    rng = np.random.default_rng(3)
    measured = np.cumsum(rng.normal(0.0, 0.2, 500))
    return measured, measured + rng.normal(0.0, 0.3, 500)


def cost(name, measured, modelled, h=H):
    return float(np.sum(((measured - modelled) * WEIGHTS[name](measured, h)) ** 2))


def test_total_least_squares_is_the_formula(currents):
    measured, modelled = currents
    expected = total_least_squares(measured.tolist(), modelled.tolist(), H)
    # Sums of 500 terms in two orders.
    assert cost("total_least_squares", measured, modelled) == pytest.approx(expected, rel=1e-12)


def test_total_least_squares_by_hand():
    # Slopes 10, 15, 25, 15 and 0 A/s, their mean square is 235.
    measured, h = np.array([0.0, 1.0, 3.0, 6.0, 6.0]), 0.1
    slopes = (10, 15, 25, 15, 0)
    expected = [math.sqrt(h) / (s * s / 235 + 1) ** 0.25 for s in slopes]
    assert total_least_squares_weights(measured, h) == pytest.approx(expected, rel=1e-12)


def test_least_squares_is_the_integral_of_the_square(currents):
    measured, modelled = currents
    expected = H * sum((a - b) ** 2 for a, b in zip(measured, modelled, strict=True))
    assert cost("least_squares", measured, modelled) == pytest.approx(expected, rel=1e-12)
    assert least_squares_weights(measured, H) == pytest.approx(np.full(500, 1e-2), rel=1e-12)


@pytest.mark.parametrize("name", WEIGHTS)
def test_identical_currents_cost_nothing(name, currents):
    measured, modelled = currents
    assert cost(name, measured, measured.copy()) == 0.0
    assert cost(name, measured, modelled) > 0.0


@pytest.mark.parametrize("name", WEIGHTS)
def test_cost_does_not_depend_on_the_sample_period(name):
    """It is an integral over time: half the period, twice the samples, the same cost.

    Sums of a smooth curve at 5 and 2.5 ms differ by their first order, a few percent.
    """
    costs = []
    for h in (5e-3, 2.5e-3):
        t = np.arange(0.0, 1.0, h)
        costs.append(cost(name, np.sin(7 * t), np.sin(7 * t) + 0.1 * np.cos(3 * t), h))
    assert costs[0] == pytest.approx(costs[1], rel=0.02)


def test_steep_stretches_count_less(currents):
    """The normal distance to a steep curve is shorter than the vertical one."""
    measured, _ = currents
    slope = np.abs(np.gradient(measured, H))
    weights = total_least_squares_weights(measured, H)
    assert np.all(np.diff(weights[np.argsort(slope)]) <= 0.0)
    assert np.all(weights <= np.sqrt(H))


def test_without_any_slope_the_two_are_one():
    constant = np.full(20, 1.3)
    assert np.array_equal(
        total_least_squares_weights(constant, H), least_squares_weights(constant, H)
    )
