# SPDX-License-Identifier: Apache-2.0
"""Least squares: the effort of a search depends on the problem."""

from collections.abc import Sequence

import numpy as np
import pytest

from ema_monitor.optimizers.driver import minimise
from ema_monitor.optimizers.gauss_newton import FACTORS
from ema_monitor.optimizers.interface import Hints
from ema_monitor.optimizers.least_squares import _SCREENS, ScreenedLeastSquares

D = 8
CENTRE = np.random.default_rng(3).uniform(0.2, 0.8, D)
ROTATION = np.linalg.qr(np.random.default_rng(4).normal(size=(D, D)))[0]
_, SMALL, LARGE = (size for size, _ in _SCREENS)


class Patient:
    """A stop criterion that never stops, not even at zero cost, so that the search converges."""

    budget = 100_000

    def reached(self, best_costs: Sequence[float]) -> bool:
        return False


def valley(x):
    """Return residuals with curvatures that differ by 100, whose only minimum is zero."""
    y = (x - CENTRE) @ ROTATION.T
    return (y + 0.3 * np.roll(y, 1, axis=1) ** 2) * np.geomspace(1.0, 0.1, D)


def search(function, start=None, *, seed=0, good_cost=0.0, fair_cost=0.0):
    """Return the evaluated batches, and the progress."""
    batches = []

    def watched(points):
        batches.append(points.copy())
        return function(points)

    start = np.full(D, 0.5) if start is None else start
    hints = Hints(good_cost, lambda: fair_cost)
    optimizer = ScreenedLeastSquares(start, np.random.default_rng(seed), hints)
    progress = list(minimise(watched, optimizer, Patient()))
    assert optimizer.converged
    return batches, progress


def screens(batches):
    """Return the sizes of screens: of batches that begin with the start, without differences."""
    first, *later = [len(batch) for batch in batches if np.array_equal(batch[0], batches[0][0])]
    return [first - batches[0].shape[1], *later]


def test_screen_is_a_latin_hypercube_around_the_start():
    start = np.linspace(0.0, 1.0, D)
    batches, _ = search(valley, start)
    [first] = [
        batch for batch in batches if len(batch) == SMALL and np.array_equal(batch[0], start)
    ]
    assert np.array_equal(first[0], start)
    # The half that is spread over the box has at most one point per cell of each component.
    for component in first[SMALL // 2 :].T:
        assert len(set(np.floor(component * SMALL))) == SMALL - SMALL // 2
    spread, drawn = (
        np.mean(np.abs(half - start)) for half in (first[SMALL // 2 :], first[: SMALL // 2])
    )
    assert drawn < 0.5 * spread


@pytest.mark.parametrize("screen", [1, 2])
def test_better_half_of_the_descents_continues_until_one_is_left(screen):
    """For an odd number, the larger half continues; differences and trials alternate until then."""
    size, starts = _SCREENS[screen]
    batches, _ = search(valley)
    first = next(
        i for i, b in enumerate(batches) if len(b) == size and np.array_equal(b[0], batches[0][0])
    )
    sizes = [len(batch) for batch in batches[first + 1 :]]
    expected = [starts]
    while expected[-1] > 1:
        expected.append(-(-expected[-1] // 2))
    alternating = [n * size for n in expected for size in (D, len(FACTORS) + 1)][:-1]
    # The best descent may have converged before the others are abandoned, but not at once.
    assert sizes[: len(alternating)] == alternating[: len(sizes)]
    assert len(sizes) >= 6


def test_good_start_needs_no_screen():
    start = CENTRE + 0.01 * np.random.default_rng(5).normal(size=D)
    batches, progress = search(valley, start, good_cost=1e-6)
    assert screens(batches) == [1]
    assert np.array_equal(batches[0][0], start)
    assert {len(batch) for batch in batches[1:]} <= {D, len(FACTORS) + 1, 1}
    assert progress[-1].point == pytest.approx(CENTRE, abs=1e-3)
    assert progress[-1].evaluations == sum(len(batch) for batch in batches)


@pytest.mark.parametrize(
    ("good_cost", "fair_cost", "expected"),
    [
        (np.inf, 0.0, [1]),
        (0.3, 0.0, [1]),
        (0.2, 0.0, [1, SMALL, LARGE]),
        # A fair cost is accepted once a second search finds nothing better.
        (0.1, 0.3, [1, SMALL]),
        (0.1, 0.2, [1, SMALL, LARGE]),
    ],
)
def test_poor_optimum_leads_to_larger_screens(good_cost, fair_cost, expected):
    """The only optimum costs 0.25, for any search."""

    def shallow(x):
        return np.concatenate([x - CENTRE, np.full((len(x), 1), 0.5)], axis=1)

    batches, progress = search(shallow, CENTRE + 0.05, good_cost=good_cost, fair_cost=fair_cost)
    assert screens(batches) == expected
    assert progress[-1].cost == pytest.approx(0.25, rel=1e-9)
    assert progress[-1].evaluations == sum(len(batch) for batch in batches)


def two_valleys(x):
    """The middle one has a cost of 0.25, a narrow one at a corner a cost of zero."""
    to_corner = x - 0.95
    wide = np.concatenate([x - 0.5, np.full((len(x), 1), 0.5)], axis=1)
    narrow = np.concatenate([to_corner, np.zeros((len(x), 1))], axis=1)
    inside = np.linalg.norm(to_corner, axis=1, keepdims=True) < 0.15
    return np.where(inside, narrow, wide)


@pytest.mark.parametrize("seed", range(5))
def test_larger_screen_finds_a_distant_optimum(seed):
    """The valley in the corner takes up half a per cent of the box."""
    start = np.full(3, 0.52)
    _, stays = search(two_valleys, start, seed=seed, good_cost=0.3)
    assert stays[-1].cost == pytest.approx(0.25, rel=1e-9)
    batches, progress = search(two_valleys, start, seed=seed, good_cost=0.2)
    assert progress[-1].cost < 1e-12
    assert progress[-1].point == pytest.approx(0.95, abs=1e-4)
    # Once it accepts an optimum, the search ends.
    assert screens(batches) in ([1, SMALL], [1, SMALL, LARGE])


@pytest.mark.parametrize("seed", range(5))
def test_fair_optimum_that_a_second_search_improves_is_searched_further(seed):
    """The search continues to the largest screen, unless it finds a good cost."""
    start = np.full(3, 0.52)
    batches, progress = search(two_valleys, start, seed=seed, good_cost=1e-15, fair_cost=0.3)
    reached = progress[-1].cost < 1e-12
    assert screens(batches) in ([1, SMALL, LARGE] if reached else [1, SMALL], [1, SMALL])


@pytest.mark.parametrize("component", [0, 5])
def test_component_without_a_finite_derivative_is_unchanged(component):
    """The residuals are NaN as soon as one component leaves its start."""
    start = np.full(D, 0.5)

    def stiff(x):
        moved = np.abs(x[:, [component]] - 0.5) > 1e-12
        return np.where(moved, np.nan, x - CENTRE)

    _, progress = search(stiff, start)
    assert progress[-1].point[component] == 0.5
    unaffected = np.arange(D) != component
    assert progress[-1].point[unaffected] == pytest.approx(CENTRE[unaffected], abs=1e-6)
