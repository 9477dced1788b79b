# SPDX-License-Identifier: Apache-2.0
"""The rules of each population algorithm, one by one."""

from typing import Any, cast

import numpy as np
import pytest

from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.differential_evolution import (
    DifferentialEvolution,
    ThesisDifferentialEvolution,
)
from ema_monitor.optimizers.genetic import (
    GeneticAlgorithm,
    expected_children,
    mutated,
    scattered,
    stochastic_uniform,
)
from ema_monitor.optimizers.grey_wolf import GreyWolf, ThesisGreyWolf, encircled, shrinking
from ema_monitor.optimizers.interface import Hints
from ema_monitor.optimizers.particle_swarm import ParticleSwarm

FEWEST = {"ga": 4, "pso": 3, "de": 3, "gwo": 3, "de_thesis": 3, "gwo_thesis": 1}
START = np.linspace(0.1, 0.9, 5)


class Scripted:
    """A source of random numbers: scripted along the first axis, and constant otherwise."""

    def __init__(self, *numbers):
        self.numbers = numbers

    def random(self, shape):
        numbers = np.resize(self.numbers, shape[0])
        return np.broadcast_to(numbers, shape[::-1]).T.copy()


def make(cls, start=START, seed=0, hints=Hints(), **settings):  # noqa: B008 - it is immutable
    return cls(start, np.random.default_rng(seed), hints, **settings)


def tell(optimizer, costs):
    """Report the costs of the requested points, and return the points."""
    points = optimizer.ask()
    costs = np.broadcast_to(np.asarray(costs, dtype=float), len(points)).copy()
    optimizer.tell(points, costs, np.sqrt(costs)[:, None])
    return points


# All of them


@pytest.mark.parametrize(("name", "fewest"), FEWEST.items())
def test_initial_population_fills_the_box_and_has_a_smallest_size(name, fewest):
    points = make(ALGORITHMS[name], population=400).ask()
    assert points.shape == (400, 5)
    # For 399 uniform numbers with mean 0.5 and variance 1/12: at least five sigma.
    assert np.mean(points[1:], axis=0) == pytest.approx(0.5, abs=0.08)
    assert np.var(points[1:], axis=0) == pytest.approx(1 / 12, abs=0.02)
    for d in (1, 3):
        optimizer = make(ALGORITHMS[name], np.full(d, 0.5), population=fewest)
        for _ in range(20):
            points = tell(optimizer, np.random.default_rng(1).random(len(optimizer.ask())))
            assert np.all((points >= 0.0) & (points <= 1.0))
    message = rf"population = {fewest - 1} individuals: expected at least {fewest}"
    with pytest.raises(ValueError, match=message):
        make(ALGORITHMS[name], population=fewest - 1)


# Genetic algorithm


def test_selection_takes_better_individuals_more_often_with_expected_numbers_rounded_up_or_down():
    expected = expected_children(50, 85)
    assert np.sum(expected) == pytest.approx(85.0, rel=1e-12)
    assert expected[0] / expected == pytest.approx(np.sqrt(np.arange(1, 51)), rel=1e-12)
    rng = np.random.default_rng(0)
    counts = np.array(
        [np.bincount(stochastic_uniform(expected, rng), minlength=50) for _ in range(2000)]
    )
    assert np.all(np.sum(counts, axis=1) == 85)
    assert np.all((counts == np.floor(expected)) | (counts == np.ceil(expected)))
    # A coin has a standard deviation of at most 0.5: four sigma of a mean of 2000.
    assert np.mean(counts, axis=0) == pytest.approx(expected, abs=0.045)


def test_elite_is_the_best_so_far_and_is_not_evaluated_again():
    optimizer = make(GeneticAlgorithm)
    rng = np.random.default_rng(2)
    reported = []
    for generation in range(20):
        points = optimizer.ask()
        assert len(points) == (50 if generation == 0 else 47)
        costs = rng.random(len(points))
        reported += [(cost, *point) for cost, point in zip(costs, points, strict=True)]
        tell(optimizer, costs)
        best = np.array(sorted(reported)[:3])
        assert np.array_equal(optimizer._elite_costs, best[:, 0])
        assert np.array_equal(optimizer._elite_x, best[:, 1:])


def test_children_of_two_parents_take_every_gene_from_one_of_them():
    mothers, fathers = np.random.default_rng(3).random((2, 500, 4))
    children = scattered(mothers, fathers, np.random.default_rng(4))
    of_mother = children == mothers
    assert np.all(of_mother | (children == fathers))
    # 500 coins: five sigma.
    assert np.mean(of_mother, axis=0) == pytest.approx(0.5, abs=0.12)


def test_four_fifths_of_the_children_have_two_parents_and_the_others_are_mutants():
    optimizer = make(GeneticAlgorithm)
    population = tell(optimizer, np.arange(50.0))
    children = optimizer.ask()
    is_inherited = np.any(children[:, None] == population, axis=1)
    assert np.all(is_inherited[:38])
    # A mutant that is clipped is on a bound.
    assert not np.any(is_inherited[38:])
    assert len(children) == 47


@pytest.mark.parametrize("step", [1e-6, 0.1, 0.5])
def test_mutants_are_a_step_away_in_all_directions(step):
    parents = np.full((2000, 3), 0.5)
    moves = mutated(parents, step, np.random.default_rng(5)) - parents
    assert np.linalg.norm(moves, axis=1) == pytest.approx(step, rel=1e-9)
    # A component has a variance of a third: five sigma of the mean of 2000.
    assert np.mean(moves, axis=0) / step == pytest.approx(0.0, abs=0.065)


def test_step_of_mutation_grows_with_success_and_shrinks_without():
    optimizer = make(GeneticAlgorithm)
    steps = []
    for cost in (10.0, 9.0, 8.0, 7.0, 8.0, 7.0, 6.0):
        tell(optimizer, cost)
        steps.append(optimizer._step)
    # Not after the first generation, which has nothing to be compared with; 1 is the largest.
    expected = [0.5, 0.75, 1.0, 1.0, 1 / 1.5, 1 / 1.5**2, 1 / 1.5]
    assert steps == pytest.approx(expected, rel=1e-12)
    for _ in range(100):
        tell(optimizer, np.inf)
    assert optimizer._step == 1e-6


# Particle swarm


def test_inertia_follows_the_counter():
    optimizer = make(ParticleSwarm)
    cost, seen = 100.0, []
    # The counter: 0; 1 to 6; 5; 6, 7, 8, 9; 8 to 0; 0.
    for improves in [True, *[False] * 6, True, *[False] * 4, *[True] * 10]:
        cost -= improves
        tell(optimizer, cost)
        seen.append(optimizer._inertia)
    stays, halves = [1.1] * 6, [0.55, 0.55, 0.275, 0.1375, 0.1, 0.1]
    grows = [0.1] * 7 + [0.2, 0.4, 0.8]
    assert seen == pytest.approx(stays + halves + grows, rel=1e-12)


def test_neighbourhoods_grow_until_the_swarm_improves():
    optimizer = make(ParticleSwarm)
    seen = []
    for cost in (9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 8.0, 8.0):
        tell(optimizer, cost)
        seen.append(optimizer._neighbours)
    # A quarter of 50, at most all the others.
    assert seen == [12, 24, 36, 48, 49, 49, 12, 24]
    assert make(ParticleSwarm, population=5)._neighbours == 2


def test_leader_is_the_best_of_other_particles_drawn_each_time():
    optimizer = make(ParticleSwarm)
    tell(optimizer, np.arange(50.0)[::-1])
    draws = np.array([optimizer._leaders() for _ in range(400)])
    assert not np.any(draws == np.arange(50))
    # The best one leads each other particle that has it among 12 of 49; four sigma.
    assert np.mean(draws[:, :49] == 49) == pytest.approx(12 / 49, abs=0.0125)
    optimizer._neighbours = 49
    assert optimizer._leaders().tolist() == [49] * 49 + [48]


def test_particle_moves_by_inertia_own_best_and_leader():
    optimizer = make(ParticleSwarm, np.full(2, 0.5), population=3)
    tell(optimizer, [3.0, 2.0, 1.0])
    before, v = optimizer.ask(), optimizer._v.copy()
    best_positions = optimizer._best_x.copy()
    optimizer._rng = cast(Any, Scripted(0.25, 0.5))
    tell(optimizer, [9.0, 9.0, 9.0])
    # With three particles, all others are neighbours.
    leader = best_positions[[2, 2, 1]]
    v = 1.1 * v + 1.49 * 0.25 * (best_positions - before) + 1.49 * 0.5 * (leader - before)
    moved = before + v
    # A velocity is set to zero at the bounds, and only there.
    inside = (moved >= 0.0) & (moved <= 1.0)
    assert 0.0 < np.mean(inside) < 1.0
    assert optimizer.ask() == pytest.approx(np.clip(moved, 0.0, 1.0), abs=1e-15)
    assert optimizer._v == pytest.approx(np.where(inside, v, 0.0), abs=1e-15)


# Differential evolution


def test_partners_differ_from_the_target_and_from_each_other():
    optimizer = make(DifferentialEvolution, population=4)
    draws = np.array([optimizer._partners() for _ in range(3000)])
    target = np.arange(4)
    first, second = draws[:, 0], draws[:, 1]
    assert not np.any((first == target) | (second == target) | (first == second))
    # Six pairs for each target, equally likely: five sigma of 3000.
    for i in range(4):
        _, counts = np.unique(4 * first[:, i] + second[:, i], return_counts=True)
        assert counts / 3000 == pytest.approx(np.full(6, 1 / 6), abs=0.035)


@pytest.mark.parametrize("cls", [DifferentialEvolution, ThesisDifferentialEvolution])
def test_donor_is_the_best_plus_a_weighted_difference(cls, monkeypatch):
    optimizer = make(cls, np.full(5, 0.5), population=4, F=0.3, CR=1.0)
    x = optimizer.ask()
    first, second = np.array([1, 2, 3, 0]), np.array([2, 3, 0, 1])
    monkeypatch.setattr(optimizer, "_partners", lambda: (first, second))
    # Differences of at most 0.3 around the middle stay inside.
    tell(optimizer, [1.0, 2.0, 3.0, 4.0])
    assert optimizer.ask() == pytest.approx(x[0] + 0.3 * (x[first] - x[second]), abs=1e-15)


@pytest.mark.parametrize("cls", [DifferentialEvolution, ThesisDifferentialEvolution])
def test_trial_has_at_least_one_component_of_the_donor(cls):
    optimizer = make(cls, CR=0.0)
    for _ in range(10):
        tell(optimizer, np.random.default_rng(7).random(50))
        assert np.all(np.sum(optimizer.ask() != optimizer._x, axis=1) <= 1)
    optimizer = make(cls, CR=0.0, F=0.1)
    tell(optimizer, np.arange(50.0))
    changed = optimizer.ask()[1:] != optimizer._x[1:]
    assert np.all(np.sum(changed, axis=1) == 1)
    assert np.all(np.any(changed, axis=0))


@pytest.mark.parametrize("cls", [DifferentialEvolution, ThesisDifferentialEvolution])
def test_trial_replaces_its_target_only_if_it_costs_less(cls):
    optimizer = make(cls, population=4)
    old = tell(optimizer, [1.0, 2.0, 3.0, np.inf])
    trials = tell(optimizer, [1.0, 1.5, np.inf, 7.0])
    assert np.array_equal(optimizer._x, [old[0], trials[1], old[2], trials[3]])
    assert optimizer._costs.tolist() == [1.0, 1.5, 3.0, 7.0]


def test_donor_outside_bounces_back_between_the_best_and_the_bound():
    optimizer = make(DifferentialEvolution)
    best = np.array([0.2, 0.2, 0.2, 0.2, 0.2])
    donors = np.tile([-1.0, -1e-9, 0.7, 1.1, 5.0], (1000, 1))
    back = optimizer._into_box(donors, best)
    assert np.all(back[:, 2] == 0.7)
    # Uniform in between; five sigma of a mean of 1000.
    for column, wall in ((0, 0.0), (1, 0.0), (3, 1.0), (4, 1.0)):
        share = (back[:, column] - 0.2) / (wall - 0.2)
        assert np.all((share >= 0.0) & (share <= 1.0))
        assert np.mean(share) == pytest.approx(0.5, abs=0.046)


def test_thesis_reflects_at_0_and_clips_at_1():
    donors = np.array([[-0.3, 0.4, 1.7, -1.2, -0.0]])
    inside = make(ThesisDifferentialEvolution)._into_box(donors, START)
    assert inside.tolist() == [[0.3, 0.4, 1.0, 1.0, 0.0]]


def test_partners_of_the_thesis_may_coincide_and_the_donor_is_then_the_best(monkeypatch):
    optimizer = make(ThesisDifferentialEvolution, CR=1.0)
    draws = np.array([optimizer._partners() for _ in range(400)])
    assert np.all(np.sort(draws, axis=2) == np.arange(50))
    # Once in a permutation of 50; five sigma.
    assert np.mean(draws == np.arange(50)) == pytest.approx(1 / 50, abs=0.004)
    assert np.mean(draws[:, 0] == draws[:, 1]) == pytest.approx(1 / 50, abs=0.005)
    same = np.arange(50)
    monkeypatch.setattr(optimizer, "_partners", lambda: (same, same))
    x = tell(optimizer, np.arange(50.0))
    assert np.array_equal(optimizer.ask(), np.tile(x[0], (50, 1)))


# Grey wolves


def test_coefficient_a_falls_linearly_from_2_to_0_and_stays():
    values = [shrinking(generation, 200) for generation in range(201)]
    assert (values[0], values[100], values[200]) == (2.0, 1.0, 0.0)
    assert np.diff(values) == pytest.approx(-0.01, abs=1e-12)
    assert shrinking(201, 200) == shrinking(10**6, 200) == 0.0


@pytest.mark.parametrize("generations", [1, 4])
def test_wolves_are_at_the_mean_of_their_leaders_once_the_budget_is_spent(generations):
    optimizer = make(GreyWolf, hints=Hints(budget=50 * generations + 49))
    for _ in range(generations):
        tell(optimizer, np.random.default_rng(8).random(50))
        points = optimizer.ask()
        assert not np.array_equal(points, np.tile(points[0], (50, 1)))
    for _ in range(3):
        tell(optimizer, 2.0)
        mean = np.mean(optimizer._leaders, axis=0)
        assert optimizer.ask() == pytest.approx(np.tile(mean, (50, 1)), abs=1e-15)


def test_thesis_ends_its_schedule_a_generation_earlier_and_at_a_third_of_alpha():
    """After a single generation, beta and delta of a wolf are still at zero."""
    optimizer = make(ThesisGreyWolf, hints=Hints(budget=50))
    points = tell(optimizer, np.arange(50.0))
    assert optimizer.ask() == pytest.approx(points / 3.0, abs=1e-15)


def test_leaders_are_the_three_best_so_far_of_the_pack():
    optimizer = make(GreyWolf)
    rng = np.random.default_rng(9)
    points, costs = np.empty((0, 5)), np.empty(0)
    for _ in range(20):
        new = rng.random(50)
        points, costs = np.concatenate([points, tell(optimizer, new)]), np.append(costs, new)
        best = np.argsort(costs)[:3]
        assert np.array_equal(optimizer._leader_costs, costs[best])
        assert np.array_equal(optimizer._leaders, points[best])


def test_wolf_moves_to_the_mean_of_points_around_its_leaders():
    wolves = np.array([[0.4, 0.9]])
    leaders = np.array([[0.5, 0.1], [0.6, 0.2], [0.8, 0.3]])[:, None]
    # a = 1, r_1 = 0.75 and r_2 = 0.25 give A = 0.5 and C = 0.5.
    first = (0.5 - 0.5 * 0.15) + (0.6 - 0.5 * 0.10) + (0.8 - 0.5 * 0.0)
    second = (0.1 - 0.5 * 0.85) + (0.2 - 0.5 * 0.80) + (0.3 - 0.5 * 0.75)
    assert second < 0.0
    gone = encircled(wolves, leaders, 1.0, cast(Any, Scripted(0.75, 0.25)))
    assert gone == pytest.approx(np.array([[first / 3.0, 0.0]]), abs=1e-15)


def test_each_wolf_of_the_thesis_has_its_own_leaders():
    optimizer = make(ThesisGreyWolf, population=1)
    assert not np.any(optimizer._leaders)
    tell(optimizer, np.inf)
    assert not np.any(optimizer._leaders)
    # alpha; beta; beta; delta; alpha, the old one is forgotten; equal to alpha: nothing; delta.
    reported = [tell(optimizer, cost)[0] for cost in (5.0, 7.0, 6.0, 9.0, 4.0, 4.0, 8.0, 8.5)]
    assert optimizer._leader_costs[:, 0].tolist() == [4.0, 6.0, 8.0]
    assert np.array_equal(optimizer._leaders[:, 0], [reported[4], reported[2], reported[6]])
