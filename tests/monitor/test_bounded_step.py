"""The bounded Gauss-Newton step against the proved minimum of the bounded problem."""

import numpy as np
import pytest
from tests.monitor.bounded_minimum import bounded_minimum

from ema_monitor.optimizers.driver import Termination, minimise
from ema_monitor.optimizers.least_squares import ScreenedLeastSquares, bounded_step

N, D = 40, 8


def problem(rng, spread, condition=30.0):
    """Start, residuals there and derivatives of a linear problem.

    Its minimum is drawn within the box widened by `spread` on all sides.
    """
    rotation = np.linalg.qr(rng.normal(size=(D, D)))[0]
    jacobian = rng.normal(size=(N, D)) @ (rotation * np.geomspace(1.0, 1.0 / condition, D))
    point, minimum = rng.random(D), rng.uniform(-spread, 1.0 + spread, D)
    return point, jacobian @ (point - minimum) + 0.1 * rng.normal(size=N), jacobian


def damped(point, residuals, jacobian, damping):
    """The same problem with its damping as further residuals: matrix and right-hand side."""
    weight = np.sqrt(damping * np.sum(jacobian**2, axis=0))
    matrix = np.vstack([jacobian, np.diag(weight)])
    return matrix, np.concatenate([jacobian @ point - residuals, weight * point])


def excess(matrix, right, x, best):
    """Share by which x costs more than the best."""
    return np.sum((matrix @ x - right) ** 2) / np.sum((matrix @ best - right) ** 2) - 1.0


@pytest.mark.parametrize("damping", [1e-6, 1e-3, 0.1, 10.0])
def test_step_within_the_box_is_the_damped_least_squares_solution(damping):
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(200):
        # A well-conditioned problem with its minimum well inside, so that noise leaves it there.
        point, residuals, jacobian = problem(rng, -0.2, condition=2.0)
        matrix, right = damped(point, residuals, jacobian, damping)
        best = np.linalg.lstsq(matrix, right)[0]
        if np.all((best > 0.0) & (best < 1.0)):
            inside += 1
            # Normal equations square the condition number of at most some 10.
            assert bounded_step(point, residuals, jacobian, damping) == pytest.approx(
                best, abs=1e-10
            )
    assert inside > 150


@pytest.mark.slow
@pytest.mark.parametrize("damping", [1e-6, 1e-3, 0.1, 10.0])
def test_step_is_the_bounded_least_squares_solution(damping):
    rng = np.random.default_rng(4)
    worst = 0.0
    for _ in range(300):
        point, residuals, jacobian = problem(rng, 0.5)
        matrix, right = damped(point, residuals, jacobian, damping)
        new = bounded_step(point, residuals, jacobian, damping)
        best = bounded_minimum(matrix, right, new)
        worst = max(worst, excess(matrix, right, new, best))
    assert worst < 1e-9


def test_component_without_effect_stays():
    rng = np.random.default_rng(5)
    point, residuals, jacobian = problem(rng, 0.5)
    jacobian[:, 3] = 0.0
    new = bounded_step(point, residuals, jacobian, 1e-6)
    assert new[3] == pytest.approx(point[3], abs=1e-12)
    assert np.array_equal(bounded_step(point, residuals, np.zeros((N, D)), 1e-6), point)


@pytest.mark.slow
def test_descent_ends_at_the_bounded_minimum_of_a_linear_problem():
    """Of 40 problems with their minimum outside the box."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        point, residuals, jacobian = problem(rng, 0.3)
        right = jacobian @ point - residuals
        optimizer = ScreenedLeastSquares(np.full(D, 0.5), rng)
        *_, last = minimise(lambda x, J=jacobian, b=right: x @ J.T - b, optimizer, Termination())
        best = bounded_minimum(jacobian, right, last.point)
        # Exact steps make it a Newton method.
        assert excess(jacobian, right, last.point, best) < 1e-9
