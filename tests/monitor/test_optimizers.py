# SPDX-License-Identifier: Apache-2.0
"""Requirements on every registered optimizer."""

import random

import numpy as np
import pytest

from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import SearchProgress, Termination, minimise
from ema_monitor.optimizers.interface import Hints

D = 8
CENTRE = np.random.default_rng(3).uniform(0.2, 0.8, D)
# Orthogonal, so that no axis of the valley is an axis of the box.
ROTATION = np.linalg.qr(np.random.default_rng(4).normal(size=(D, D)))[0]
MIDDLE = np.full(D, 0.5)
LONG = Termination(budget=10_000, tolerance=0.0, stall_generations=1000)
SHORT = Termination(budget=2500, tolerance=0.0, stall_generations=1000)
SEEDS = range(5)

# Intentionally faulty, as in the thesis. Their precision is only compared with random points; all
# other requirements apply to them, too.
IMPRECISE = {"gwo_thesis": "beta and delta of a wolf may stay at the zero vector and draw it there"}

pytestmark = pytest.mark.parametrize("name", ALGORITHMS)


def blind(x):
    """Return residuals of a quadratic in which one component has no effect."""
    return x[:, 1:] - CENTRE[1:]


def valley(x):
    """Return residuals of a quadratic whose curvatures differ by 100, away from the middle."""
    return (x - CENTRE) @ ROTATION.T * np.geomspace(1.0, 0.1, D)


def waves(x):
    """Return residuals of y^2 + sin^2(pi y) in three components: 27 minima, others cost >= 0.9."""
    y = 3.0 * (x - CENTRE[:3])
    return np.concatenate([y, np.sin(np.pi * y)], axis=1)


def cost_at(function, point):
    return float(np.sum(function(point[None]) ** 2))


def make(name, *, start=MIDDLE, seed=0, budget=LONG.budget):
    return ALGORITHMS[name](start, np.random.default_rng(seed), Hints(budget=budget))


def run(name, function, *, start=MIDDLE, seed=0, termination=LONG):
    """Return the progress of a run, after checking that all points are in the box."""

    def within_box(points):
        assert points.shape[1:] == start.shape
        assert np.all((points >= 0.0) & (points <= 1.0))
        return function(points)

    optimizer = make(name, start=start, seed=seed, budget=termination.budget)
    return list(minimise(within_box, optimizer, termination))


def best_of_random(function, *, d=D, points=LONG.budget):
    """Return the lowest cost of as many random points as a run may evaluate."""
    return np.min(np.sum(function(np.random.default_rng(7).random((points, d))) ** 2, axis=1))


def worst_of_most(costs):
    """Return the second largest cost: chance may spoil one run in five, but no more."""
    return sorted(costs)[-2]


def same(a: SearchProgress, b: SearchProgress) -> bool:
    return a.cost == b.cost and a.evaluations == b.evaluations and np.array_equal(a.point, b.point)


@pytest.mark.slow
@pytest.mark.parametrize(("function", "share"), [(blind, 1e-3), (valley, 1e-2)])
def test_quadratic_is_solved(name, function, share):
    """The tolerance is 3 % of the distance, 0.005 in a component: a grey wolf's final step.

    The other optimizers reach 1e-7 of the cost and better. A tenth of the distance along the
    flattest direction of the valley costs 1e-2 of it.
    """
    costs = [run(name, function, seed=seed)[-1].cost for seed in SEEDS]
    fine = share * cost_at(function, MIDDLE)
    assert worst_of_most(costs) < (best_of_random(function) if name in IMPRECISE else fine)


def test_global_minimum_is_reached_from_a_local_one(name):
    # Where 2 y + pi sin(2 pi y) = 0 near y = 1, in each component.
    start = CENTRE[:3] + 0.9095 / 3.0
    for step in 0.02 * np.concatenate([np.eye(3), -np.eye(3)]):
        assert cost_at(waves, start + step) > cost_at(waves, start) > 2.0
    ends = [run(name, waves, start=start, seed=seed)[-1] for seed in SEEDS]
    # The best of the other minima costs 0.9; 10,000 evaluations are plenty for one valley. Near the
    # minimum, y^2 + sin^2(pi y) = 98 (x - centre)^2.
    assert worst_of_most([end.cost for end in ends]) < 1e-2
    assert worst_of_most([np.max(np.abs(end.point - CENTRE[:3])) for end in ends]) < 0.011


@pytest.mark.parametrize("d", [1, 3, 20])
def test_points_are_within_the_box_in_any_dimension(name, d):
    """The minimum is in a corner far outside, so that only the box limits the points."""

    def outside(x):
        return x + np.where(np.arange(d) % 2, 3.0, -4.0)

    start = np.full(d, 0.3)
    last = run(name, outside, start=start, termination=SHORT)[-1]
    assert last.point.shape == (d,)
    assert last.cost < cost_at(outside, start)


def test_minimum_in_a_corner_is_reached(name):
    """A healthy actuator has most of its faults at their bound."""
    corner = (np.arange(D) % 2).astype(float)

    def outside(x):
        return x - np.where(corner == 1.0, 1.2, -0.2)

    ends = [run(name, outside, seed=seed)[-1] for seed in SEEDS]
    if name in IMPRECISE:
        assert worst_of_most([end.cost for end in ends]) < best_of_random(outside)
    else:
        # The bounds stop the search exactly, or up to a difference step or the step of a wolf.
        assert worst_of_most([np.max(np.abs(end.point - corner)) for end in ends]) < 1e-3


def test_same_seed_gives_the_same_run_and_global_random_state_is_unchanged(name):
    expected = run(name, valley, seed=5, termination=SHORT)
    before = np.random.get_state(), random.getstate()  # noqa: NPY002
    np.random.seed(1)  # noqa: NPY002
    random.seed(1)
    seeded = repr(np.random.get_state()), random.getstate()  # noqa: NPY002
    try:
        progress = run(name, valley, seed=5, termination=SHORT)
        after = repr(np.random.get_state()), random.getstate()  # noqa: NPY002
    finally:
        np.random.set_state(before[0])  # noqa: NPY002
        random.setstate(before[1])
    assert all(same(a, b) for a, b in zip(progress, expected, strict=True))
    assert after == seeded


def test_first_evaluated_point_is_the_start(name):
    """Therefore no run ends with a higher cost than it started with."""
    assert np.array_equal(make(name, start=CENTRE).ask()[0], CENTRE)
    assert run(name, blind, start=CENTRE, termination=SHORT)[-1].cost == 0.0


@pytest.mark.slow
def test_region_without_a_finite_cost_is_avoided(name):
    """The cost is NaN beyond a wall as close to the minimum as a difference step."""
    beyond = 0.452
    centre = np.where(np.arange(D) == 0, 0.45, CENTRE)

    def walled(x):
        return np.where(x[:, :1] > beyond, np.nan, x - centre)

    start = np.where(np.arange(D) == 0, 0.3, MIDDLE)
    ends = [run(name, walled, start=start, seed=seed)[-1] for seed in SEEDS]
    assert all(end.point[0] <= beyond for end in ends)
    share = 1.0 if name in IMPRECISE else 1e-3
    assert worst_of_most([end.cost for end in ends]) < share * cost_at(walled, start)


def test_run_without_any_finite_cost_ends_and_reports_it(name):
    progress = run(name, lambda x: np.full_like(x, np.nan), termination=Termination(budget=5000))
    assert all(p.cost == np.inf for p in progress)
    assert progress[-1].evaluations <= 5000


def test_constant_cost_is_tolerated(name):
    """There is no direction to descend, and no curvature to divide by."""
    assert run(name, np.ones_like, termination=SHORT)[-1].cost == D
