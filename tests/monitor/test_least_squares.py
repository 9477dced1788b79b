"""How much of a search it takes: near starts, small screens, and larger ones where they fail."""

import numpy as np
import pytest

from ema_monitor.optimizers.driver import Termination, minimise
from ema_monitor.optimizers.least_squares import _DAMPINGS, _SCREENS, ScreenedLeastSquares

D = 8
CENTRE = np.random.default_rng(3).uniform(0.2, 0.8, D)
ROTATION = np.linalg.qr(np.random.default_rng(4).normal(size=(D, D)))[0]
SMALL, LARGE = (size for size, _ in _SCREENS)
# Differences and trial steps of one descent.
ROUND = D + len(_DAMPINGS)
# Not even a cost of nothing ends a search before it has converged.
PATIENT = Termination(budget=100_000, target=-1.0, tolerance=0.0, stall_generations=10_000)


def valley(x):
    """Curved, with curvatures that differ by 100, and its only minimum worth nothing."""
    y = (x - CENTRE) @ ROTATION.T
    return (y + 0.3 * np.roll(y, 1, axis=1) ** 2) * np.geomspace(1.0, 0.1, D)


def search(function, start=None, *, seed=0, **hints):
    """Batches asked for, and the progress."""
    batches = []

    def watched(points):
        batches.append(points.copy())
        return function(points)

    start = np.full(D, 0.5) if start is None else start
    optimizer = ScreenedLeastSquares(start, np.random.default_rng(seed), **hints)
    progress = list(minimise(watched, optimizer, PATIENT))
    assert optimizer.converged
    return batches, progress


def screens(batches):
    """Sizes of the batches that begin with the start, as only screens do."""
    return [len(batch) for batch in batches if np.array_equal(batch[0], batches[0][0])]


def test_first_batch_is_a_latin_hypercube_about_the_start():
    start = np.linspace(0.0, 1.0, D)
    [first, *_], _ = search(valley, start)
    assert len(first) == SMALL
    assert np.array_equal(first[0], start)
    # The half that is spread over the box has at most one point in a cell of each component.
    for component in first[SMALL // 2 :].T:
        assert len(set(np.floor(component * SMALL))) == SMALL - SMALL // 2
    spread, drawn = (
        np.mean(np.abs(half - start)) for half in (first[SMALL // 2 :], first[: SMALL // 2])
    )
    assert drawn < 0.5 * spread


def test_descents_become_fewer_until_one_is_left():
    batches, progress = search(valley)
    assert screens(batches) == [SMALL]
    starts = _SCREENS[0][1]
    sizes = [len(batch) for batch in batches[1:]]
    differences, trials = np.array(sizes[0::2]) // D, np.array(sizes[1::2]) // len(_DAMPINGS)
    assert np.array_equal(differences, trials)
    assert list(differences[:3]) == [starts, -(-starts // 2), -(-starts // 4)]
    assert differences[-1] == 1
    assert progress[-1].cost < 1e-9
    assert progress[-1].evaluations == sum(len(batch) for batch in batches)


def test_of_an_odd_number_of_descents_the_larger_half_goes_on():
    batches, _ = search(valley, good_cost=-1.0)
    large = [len(batch) for batch in batches].index(LARGE)
    starts, counts = _SCREENS[1][1], [len(batch) // D for batch in batches[large + 1 :: 2]]
    expected = [starts]
    while expected[-1] > 1:
        expected.append(-(-expected[-1] // 2))
    assert counts[: len(expected)] == expected


def test_near_start_takes_no_screen():
    near = CENTRE + 0.01 * np.random.default_rng(5).normal(size=D)
    batches, progress = search(valley, near, near=True)
    assert screens(batches) == [1]
    assert np.array_equal(batches[0], near[None])
    assert {len(batch) for batch in batches[1:]} == {D, len(_DAMPINGS)}
    assert progress[-1].point == pytest.approx(CENTRE, abs=1e-3)
    _, cold = search(valley, near)
    assert progress[-1].evaluations == 1 + (len(batches) - 1) // 2 * ROUND
    assert progress[-1].evaluations < 0.5 * cold[-1].evaluations


@pytest.mark.parametrize(
    ("good_cost", "near", "expected"),
    [
        (np.inf, False, [SMALL]),
        (0.3, False, [SMALL]),
        (0.2, False, [SMALL, LARGE]),
        (0.3, True, [1]),
        (0.2, True, [1, SMALL, LARGE]),
        (0.0, True, [1, SMALL, LARGE]),
    ],
)
def test_poor_optimum_leads_to_a_larger_screen(good_cost, near, expected):
    """Where the valleys have one minimum, and that costs 0.25, whatever is searched."""

    def shallow(x):
        return np.concatenate([x - CENTRE, np.full((len(x), 1), 0.5)], axis=1)

    batches, progress = search(shallow, CENTRE + 0.05, near=near, good_cost=good_cost)
    assert screens(batches) == expected
    assert progress[-1].cost == pytest.approx(0.25, rel=1e-9)
    assert progress[-1].evaluations == sum(len(batch) for batch in batches)


def two_valleys(x):
    """One about the middle costs 0.25 at its bottom, a narrow one about a corner nothing."""
    to_corner = x - 0.95
    wide = np.concatenate([x - 0.5, np.full((len(x), 1), 0.5)], axis=1)
    narrow = np.concatenate([to_corner, np.zeros((len(x), 1))], axis=1)
    inside = np.linalg.norm(to_corner, axis=1, keepdims=True) < 0.15
    return np.where(inside, narrow, wide)


@pytest.mark.parametrize("seed", range(5))
def test_larger_screen_finds_what_the_start_does_not(seed):
    """The corner's valley holds half a percent of the box."""
    start = np.full(3, 0.52)
    _, stays = search(two_valleys, start, seed=seed, near=True, good_cost=0.3)
    assert stays[-1].cost == pytest.approx(0.25, rel=1e-9)
    batches, found = search(two_valleys, start, seed=seed, near=True, good_cost=0.2)
    assert found[-1].cost < 1e-12
    assert found[-1].point == pytest.approx(0.95, abs=1e-4)
    # Once there is an optimum that it believes, it does not go on.
    assert screens(batches) in ([1, SMALL], [1, SMALL, LARGE])


def test_misleading_near_start_costs_little_more_than_none():
    """It is one more descent."""
    far = np.where(CENTRE > 0.5, 0.02, 0.98)
    batches, progress = search(valley, far, near=True, good_cost=1e-6)
    assert progress[-1].cost < 1e-6
    assert screens(batches)[0] == 1


@pytest.mark.parametrize("component", [0, 5])
def test_column_without_derivative_leaves_its_component(component):
    """Not a number as soon as one component moves from where it starts."""
    start = np.full(D, 0.5)

    def stiff(x):
        moved = np.abs(x[:, [component]] - 0.5) > 1e-12
        return np.where(moved, np.nan, x - CENTRE)

    _, progress = search(stiff, start, near=True)
    assert progress[-1].point[component] == 0.5
    others = np.arange(D) != component
    assert progress[-1].point[others] == pytest.approx(CENTRE[others], abs=1e-6)


def test_without_any_cost_no_descent_is_begun():
    batches, progress = search(lambda x: np.full_like(x, np.nan), near=True, good_cost=1.0)
    assert [len(batch) for batch in batches] == [1, SMALL, LARGE]
    assert progress[-1].cost == np.inf


def test_start_at_the_optimum_ends_at_once():
    batches, progress = search(lambda x: x - CENTRE, CENTRE, near=True, good_cost=1.0)
    assert [len(batch) for batch in batches] == [1, D, len(_DAMPINGS)]
    assert progress[-1].cost == 0.0
