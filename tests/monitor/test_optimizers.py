"""What every registered optimizer must do, whatever it is."""

import itertools

import numpy as np
import pytest

from ema_monitor.optimizers import ALGORITHMS, DEFAULT_ALGORITHM
from ema_monitor.optimizers.driver import Progress, Termination, minimise

D = 8
CENTRE = np.random.default_rng(3).uniform(0.2, 0.8, D)
# Orthogonal, so that no axis of the valley is an axis of the box.
ROTATION = np.linalg.qr(np.random.default_rng(4).normal(size=(D, D)))[0]
MIDDLE = np.full(D, 0.5)
LONG = Termination(budget=10_000, tolerance=0.0, stall_generations=1000)
SHORT = Termination(budget=2500, tolerance=0.0, stall_generations=1000)

pytestmark = pytest.mark.parametrize("name", ALGORITHMS)


def sphere(x):
    return x - CENTRE


def valley(x):
    """Quadratic whose curvatures differ by 100, away from the middle."""
    return (x - CENTRE) @ ROTATION.T * np.geomspace(1.0, 0.1, D)


def waves(x):
    """y^2 + sin^2(pi y) in each of three components: 27 minima, the others worth 0.9 and more."""
    y = 3.0 * (x - CENTRE[:3])
    return np.concatenate([y, np.sin(np.pi * y)], axis=1)


def cost_at(function, point):
    return float(np.sum(function(point[None]) ** 2))


def run(name, function, *, start=MIDDLE, seed=0, termination=LONG):
    optimizer = ALGORITHMS[name](start, np.random.default_rng(seed))
    return list(minimise(function, optimizer, termination))


def same(a: Progress, b: Progress) -> bool:
    return a.cost == b.cost and a.evaluations == b.evaluations and np.array_equal(a.point, b.point)


class Watched:
    """A function that keeps what it was asked."""

    def __init__(self, function):
        self.function = function
        self.batches = []

    def __call__(self, points):
        self.batches.append(points.copy())
        return self.function(points)


def test_sphere_is_solved(name):
    # Population methods of 50 do it to 1e-8 and better in 200 generations, slow ones to 1e-4.
    assert run(name, sphere)[-1].cost < 1e-3 * cost_at(sphere, MIDDLE)


def test_shifted_ill_conditioned_quadratic_is_solved(name):
    # A tenth of the distance along the flattest direction costs 1e-2 of it.
    assert run(name, valley)[-1].cost < 1e-2 * cost_at(valley, MIDDLE)


@pytest.mark.parametrize("seed", range(3))
def test_best_of_many_minima_is_found_from_another(name, seed):
    # Where 2 y + pi sin(2 pi y) = 0 next to y = 1, in each component.
    start = CENTRE[:3] + 0.9095 / 3.0
    for step in 0.02 * np.concatenate([np.eye(3), -np.eye(3)]):
        assert cost_at(waves, start + step) > cost_at(waves, start) > 2.0
    last = run(name, waves, start=start, seed=seed)[-1]
    # The best of the other minima is worth 0.9; 10,000 evaluations are plenty for one valley.
    assert last.cost < 1e-2
    assert last.point == pytest.approx(CENTRE[:3], abs=0.03)


@pytest.mark.parametrize("d", [1, 2, 9])
def test_points_are_within_the_box(name, d):
    """With the minimum in a corner far outside, so that the box is all that holds them."""
    watched = Watched(lambda x: x + np.where(np.arange(d) % 2, 3.0, -4.0))
    run(name, watched, start=np.full(d, 0.3), termination=SHORT)
    for points in watched.batches:
        assert points.ndim == 2
        assert points.shape[1] == d
        assert np.all((points >= 0.0) & (points <= 1.0))


def test_minimum_in_a_corner_is_found(name):
    """A healthy actuator has most of its faults at their bound."""
    corner = (np.arange(D) % 2).astype(float)
    last = run(name, lambda x: x - np.where(corner == 1.0, 1.2, -0.2))[-1]
    # Where the walls stop the search, exactly or to what a swarm leaves.
    assert last.point == pytest.approx(corner, abs=0.02)


def test_same_seed_makes_the_same_run(name):
    runs = [run(name, valley, seed=5, termination=SHORT) for _ in range(2)]
    assert len(runs[0]) == len(runs[1])
    assert all(same(a, b) for a, b in zip(*runs, strict=True))


def test_another_seed_makes_another_run(name):
    runs = [run(name, valley, seed=seed, termination=SHORT) for seed in (5, 6)]
    assert not same(runs[0][-1], runs[1][-1])


def test_best_cost_never_rises(name):
    progress = run(name, valley)
    costs = [p.cost for p in progress]
    assert all(after <= before for before, after in itertools.pairwise(costs))
    for p in progress:
        # Costs in a batch and alone are summed in different orders.
        assert p.cost == pytest.approx(cost_at(valley, p.point), rel=1e-9, abs=1e-20)


def test_best_is_the_best_of_all_that_was_asked(name):
    watched = Watched(valley)
    last = run(name, watched, termination=SHORT)[-1]
    points = np.concatenate(watched.batches)
    costs = np.sum(valley(points) ** 2, axis=1)
    assert last.cost == pytest.approx(np.min(costs), rel=1e-9, abs=1e-20)
    assert np.any(np.all(points == last.point, axis=1))


@pytest.mark.parametrize("budget", [1000, 1777, 2500])
def test_evaluations_are_counted_and_within_budget(name, budget):
    watched = Watched(valley)
    termination = Termination(budget=budget, tolerance=0.0, stall_generations=1000)
    progress = run(name, watched, termination=termination)
    sizes = [len(points) for points in watched.batches]
    assert [p.evaluations for p in progress] == list(np.cumsum(sizes))
    assert [p.generation for p in progress] == list(range(1, len(sizes) + 1))
    assert progress[-1].evaluations <= budget


def test_run_never_ends_worse_than_its_start(name):
    assert run(name, sphere, start=CENTRE, termination=SHORT)[-1].cost == 0.0


def test_budget_below_one_generation_is_refused(name):
    optimizer = ALGORITHMS[name](MIDDLE, np.random.default_rng(0))
    n = len(optimizer.ask())
    run = minimise(sphere, optimizer, Termination(budget=n), reserve=1)
    with pytest.raises(ValueError, match=rf"budget = {n} evaluations: at least {n + 1} are needed"):
        next(run)


@pytest.mark.parametrize("beyond", [0.55, 0.452])
def test_region_without_cost_is_avoided(name, beyond):
    """Not a number beyond a wall, be it as close to the minimum as a difference step."""
    centre = np.where(np.arange(D) == 0, 0.45, CENTRE)

    def walled(x):
        return np.where(x[:, :1] > beyond, np.nan, x - centre)

    watched = Watched(walled)
    start = np.where(np.arange(D) == 0, 0.3, MIDDLE)
    last = run(name, watched, start=start)[-1]
    for points in watched.batches:
        assert np.all((points >= 0.0) & (points <= 1.0))
    assert last.point[0] <= beyond
    assert last.cost < 1e-3 * cost_at(walled, start)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_without_any_cost_the_run_ends_and_says_so(name, value):
    progress = run(name, lambda x: np.full_like(x, value), termination=Termination(budget=5000))
    assert all(p.cost == np.inf for p in progress)
    assert progress[-1].evaluations <= 5000


def test_constant_cost_is_tolerated(name):
    """Nothing to climb, no curvature to divide by."""
    watched = Watched(np.ones_like)
    progress = run(name, watched, termination=SHORT)
    assert progress[-1].cost == D
    for points in watched.batches:
        assert np.all((points >= 0.0) & (points <= 1.0))


def test_component_without_effect_is_tolerated(name):
    def blind(x):
        return x[:, 1:] - CENTRE[1:]

    watched = Watched(blind)
    last = run(name, watched)[-1]
    assert last.cost < 1e-3 * cost_at(blind, MIDDLE)
    for points in watched.batches:
        assert np.all((points >= 0.0) & (points <= 1.0))


def test_cancelled_run_leaves_its_best(name):
    whole = run(name, valley, termination=SHORT)
    for stop in range(1, min(len(whole), 6)):
        optimizer = ALGORITHMS[name](MIDDLE, np.random.default_rng(0))
        *_, last = itertools.islice(minimise(valley, optimizer, SHORT), stop)
        assert same(last, whole[stop - 1])
        assert np.isfinite(last.cost)
        assert np.all((last.point >= 0.0) & (last.point <= 1.0))


def test_start_is_not_changed(name):
    start = MIDDLE.copy()
    run(name, valley, start=start, termination=SHORT)
    assert np.array_equal(start, MIDDLE)


def test_says_whether_it_wants_smooth_residuals(name):
    optimizer = ALGORITHMS[name](MIDDLE, np.random.default_rng(0))
    assert optimizer.uses_residuals in (True, False)
    assert optimizer.converged is False
    assert DEFAULT_ALGORITHM in ALGORITHMS
