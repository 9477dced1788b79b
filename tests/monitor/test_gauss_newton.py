# SPDX-License-Identifier: Apache-2.0
"""Gauss-Newton: steps compared with verified minima, choice of trials, and end of a descent."""

import numpy as np
import pytest

from ema_monitor.optimizers.bounded_quadratic import lowest_of
from ema_monitor.optimizers.driver import minimise
from ema_monitor.optimizers.gauss_newton import (
    LeastSquaresProblem,
    LevenbergMarquardt,
    LineSearch,
    Stopping,
    descend,
)
from ema_monitor.optimizers.least_squares import ScreenedLeastSquares
from ema_monitor.optimizers.linear_model import Linearisation, Quadratic, refitted

from .bounded_minimum import bounded_minimum

D = 8
N = 40


def problem(rng, spread):
    """Return start, residuals there and derivatives of a linear problem.

    Its minimum is drawn from the box widened by `spread` on all sides.
    """
    rotation = np.linalg.qr(rng.normal(size=(D, D)))[0]
    jacobian = rng.normal(size=(N, D)) @ (rotation * np.geomspace(1.0, 1.0 / 30.0, D))
    point, minimum = rng.random(D), rng.uniform(-spread, 1.0 + spread, D)
    return point, jacobian @ (point - minimum) + 0.1 * rng.normal(size=N), jacobian


def damped(point, residuals, jacobian, damping):
    """Return matrix and right-hand side of the problem with its damping as further residuals."""
    weight = np.sqrt(damping * np.sum(jacobian**2, axis=0))
    matrix = np.vstack([jacobian, np.diag(weight)])
    return matrix, np.concatenate([jacobian @ point - residuals, weight * point])


def excess(matrix, right, x, best):
    """Return the relative excess of the cost of x over the lowest cost."""
    return np.sum((matrix @ x - right) ** 2) / np.sum((matrix @ best - right) ** 2) - 1.0


@pytest.mark.parametrize("damping", [1e-6, 1e-3, 0.1, 10.0])
@pytest.mark.parametrize("spread", [-0.2, 0.5])
def test_step_is_the_bounded_least_squares_solution(damping, spread):
    """The problems have their minimum well inside the box, or mostly outside."""
    rng = np.random.default_rng(4)
    for _ in range(100):
        point, residuals, jacobian = problem(rng, spread)
        matrix, right = damped(point, residuals, jacobian, damping)
        new = Quadratic.of(Linearisation(point, residuals, jacobian)).damped(damping).lowest()
        assert excess(matrix, right, new, bounded_minimum(matrix, right, new)) < 1e-9


def test_component_without_effect_is_unchanged():
    rng = np.random.default_rng(5)
    point, residuals, jacobian = problem(rng, 0.5)
    jacobian[:, 3] = 0.0
    new = Quadratic.of(Linearisation(point, residuals, jacobian)).damped(2.0).lowest()
    assert new[3] == pytest.approx(point[3], abs=1e-12)
    blind = Linearisation(point, residuals, np.zeros((N, D)))
    unmoved = Quadratic.of(blind).damped(1.0).lowest()
    assert np.array_equal(unmoved, point)


def test_descent_ends_at_the_bounded_minimum_of_a_linear_problem():
    """The 20 problems have their minimum outside the box."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        point, residuals, jacobian = problem(rng, 0.3)
        right = jacobian @ point - residuals
        optimizer = ScreenedLeastSquares(np.full(D, 0.5), rng)
        *_, last = minimise(lambda x, J=jacobian, b=right: x @ J.T - b, optimizer, Unending())
        best = bounded_minimum(jacobian, right, last.point)
        # With exact steps, this is Newton's method.
        assert excess(jacobian, right, last.point, best) < 1e-9


@pytest.mark.parametrize("seed", range(20))
def test_refit_is_constrained_least_squares(seed):
    """Significant components are fitted within the unit box; the others stay healthy."""
    rng, d = np.random.default_rng(seed), 8 + seed % 2
    point, healthy = rng.uniform(-0.3, 1.3, d).clip(0.0, 1.0), np.full(d, 0.1)
    residuals, jacobian = rng.normal(size=200), rng.normal(size=(200, d)) * rng.uniform(1, 9, d)
    fitted = rng.random(d) < 0.6
    refit = refitted(Linearisation(point, residuals, jacobian), healthy, fitted)
    normal, start = jacobian.T @ jacobian, np.where(fitted, point, healthy)
    of_fitted = lowest_of(normal, jacobian.T @ residuals, point, start, fitted)
    assert of_fitted == pytest.approx(refit, abs=1e-6)
    right = jacobian @ point - residuals - jacobian[:, ~fitted] @ healthy[~fitted]
    best = bounded_minimum(jacobian[:, fitted], right, refit[fitted])
    assert np.array_equal(refit[~fitted], healthy[~fitted])
    # The ridge is 1e-9 of the largest diagonal entry.
    assert refit[fitted] == pytest.approx(best, abs=1e-6)


@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_bounds_apply_to_a_box_of_any_size(damping):
    """The same problem in other units has the same minimum."""
    rng = np.random.default_rng(6)
    for _ in range(50):
        point, residuals, jacobian = problem(rng, 0.5)
        lower, span = rng.normal(size=D), rng.uniform(0.1, 10.0, D)
        unit = Quadratic.of(Linearisation(point, residuals, jacobian)).damped(damping)
        wide = Linearisation(lower + span * point, residuals, jacobian / span)
        point_found = Quadratic.of(wide).damped(damping).lowest_between(lower, lower + span)
        assert (point_found - lower) / span == pytest.approx(unit.lowest(), abs=1e-9)


def bent(x):
    """Return residuals with a minimum of zero at 0.5, for which full steps are too long."""
    return np.arctan(20.0 * (x - 0.5)) / 20.0


class Unending:
    """A stop criterion that never stops: only convergence ends a search."""

    budget = 100_000

    def reached(self, best_costs):
        return False


class Watched:
    """A function with exact derivatives that records the points where it is evaluated."""

    def __init__(self, weight=lambda x: 1.0):
        self.asked, self.linearised, self.weight, self.now = [], [], weight, 1.0
        self.problem = LeastSquaresProblem(self.residuals, self.linearise)

    def residuals(self, points):
        self.asked.append(len(points))
        return self.now * bent(points)

    def linearise(self, point):
        self.linearised.append(point)
        self.now = self.weight(point)
        slope = self.now / (1.0 + (20.0 * (point - 0.5)) ** 2)
        return Linearisation(point, self.now * bent(point), np.diag(slope))


def lowest(at):
    """Return where the linear model is lowest, ignoring bounds."""
    return Quadratic.of(at).damped(1e-12).lowest_between(np.full(1, -1e3), np.full(1, 1e3))


TOGETHER = LineSearch(lowest, ((1.0, 0.5, 0.2, 0.05),))
IN_TURN = LineSearch(lowest, ((1.0,), (0.5,), (0.2,), (0.05,)))
FAR = np.array([[0.7]])


@pytest.mark.parametrize("search", [TOGETHER, IN_TURN, LevenbergMarquardt()])
def test_descent_reaches_the_minimum_where_full_steps_diverge(search):
    function = Watched()
    descent = descend(function.problem, FAR, search, Stopping(50, step=1e-9))
    assert descent.point == pytest.approx(0.5, abs=1e-6)
    full = Watched()
    alone = LineSearch(lowest, ((1.0,),))
    assert descend(full.problem, FAR, alone, Stopping(50)).point == pytest.approx(0.7)


def test_later_groups_are_evaluated_only_if_earlier_ones_gain_nothing():
    function = Watched()
    descend(function.problem, FAR, IN_TURN, Stopping(1))
    # The start, and the shares up to the first that gains.
    assert function.asked == [1, 1, 1, 1]
    near = Watched()
    descend(near.problem, np.array([[0.51]]), IN_TURN, Stopping(1))
    assert near.asked == [1, 1]


def test_descent_begins_at_the_lowest_finite_start():
    function = Watched()
    starts = np.array([[np.nan], [0.8], [0.52], [0.1]])
    descend(function.problem, starts, TOGETHER, Stopping(1))
    assert function.linearised[0] == [0.52]
    blind = Watched()
    descent = descend(blind.problem, np.full((2, 1), np.nan), TOGETHER, Stopping(5))
    assert not blind.linearised
    assert np.isnan(descent.point)


def test_descent_ends_if_a_derivative_is_not_finite():
    function = Watched(lambda x: np.nan if x < 0.6 else 1.0)
    descent = descend(function.problem, FAR, IN_TURN, Stopping(50))
    assert descent.point < 0.6
    assert len(function.linearised) == 2


@pytest.mark.parametrize(
    ("stopping", "steps"),
    [
        (Stopping(3), 3),
        # No step gains half of the remaining cost, once the best share is small.
        (Stopping(50, gain=0.999), 1),
        (Stopping(50, step=1.0), 1),
        # No full step promises more than the whole cost.
        (Stopping(50, promise=1.0), 1),
    ],
)
def test_each_tolerance_ends_a_descent(stopping, steps):
    function = Watched()
    descend(function.problem, FAR, TOGETHER, stopping)
    assert len(function.linearised) == steps


def test_step_that_gains_too_little_is_rejected():
    function = Watched()
    assert descend(function.problem, FAR, TOGETHER, Stopping(50, gain=0.999)).point == FAR[0]


def test_promise_kept_by_a_good_fit_ends_a_descent():
    """In a linear problem, the linear model predicts the gain exactly."""

    def line(points):
        return np.concatenate([points - 0.3, np.full((len(points), 1), 0.1)], axis=1)

    linear = LeastSquaresProblem(
        line, lambda x: Linearisation(x, line(x[None])[0], np.array([[1.0], [0.0]]))
    )
    good, poor = (
        descend(linear, FAR, TOGETHER, Stopping(9, promise=1e-2, good_cost=cost))
        for cost in (0.02, 0.005)
    )
    assert (good.iterations, poor.iterations) == (1, 2)
    assert good.point == poor.point == pytest.approx(0.3)


def test_cost_follows_reweighted_residuals():
    """A step is judged with the weights at its start, and not with earlier weights."""
    function = Watched(lambda x: 1.0 / abs(float(x[0]) - 0.5))
    descent = descend(function.problem, FAR, IN_TURN, Stopping(50, step=1e-7))
    assert descent.point == pytest.approx(0.5, abs=1e-6)
