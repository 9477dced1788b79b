# SPDX-License-Identifier: Apache-2.0
"""Genetic algorithm with elites, scattered crossover and an adaptive mutation step."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array
from ema_monitor.optimizers.population import Population

_ELITE_FRACTION: Final = 0.05
_CROSSOVER_FRACTION: Final = 0.8
_INITIAL_STEP: Final = 0.5
_STEP_RANGE: Final = (1e-6, 1.0)
_STEP_GROWTH: Final = 1.5
_STEP_DECAY: Final = 1.0 / _STEP_GROWTH


class GeneticAlgorithm(Population):
    """Genetic algorithm that follows the documentation of Matlab's ``ga`` with bounds (R2018a).

    The best 5 % of a population survive unchanged and are not evaluated again. Of the remaining
    places, 80 % are filled by children of two parents, with each gene taken from either parent with
    equal probability (scattered crossover). The rest are mutants of one parent. Parents are drawn
    by stochastic uniform selection, in proportion to 1 / sqrt(rank).

    A mutant is one step away from its parent in a random direction, clipped to the box. The step
    rule of Matlab's adaptive feasible mutation is not published. Here the initial step is half the
    width of the box. The step is multiplied by 1.5 after a generation with a new best point, and
    divided by 1.5 otherwise, but stays between 1e-6 and 1 times the width. This is a success rule
    similar to Rechenberg's (1973), in equilibrium if every other generation improves.

    Parameters and errors are as in `Population`.

    References
    ----------
    MathWorks, "Genetic algorithm options", Global Optimization Toolbox,
    https://www.mathworks.com/help/gads/genetic-algorithm-options.html.
    """

    # One elite, two children by crossover and one by mutation.
    FEWEST = 4

    def _begin(self, population: int, d: int) -> None:
        self._elites = int(np.ceil(_ELITE_FRACTION * population))
        self._crossed = round(_CROSSOVER_FRACTION * (population - self._elites))
        self._mutants = population - self._elites - self._crossed
        self._elite_x = np.empty((0, d))
        self._elite_costs = np.empty(0)
        self._step = _INITIAL_STEP

    def _next(self, points: Array, costs: Array) -> Array:
        if len(self._elite_costs):
            improved = np.min(costs) < self._elite_costs[0]
            factor = _STEP_GROWTH if improved else _STEP_DECAY
            self._step = float(np.clip(factor * self._step, *_STEP_RANGE))
        points = np.concatenate([self._elite_x, points])
        costs = np.concatenate([self._elite_costs, costs])
        ranking = np.argsort(costs, kind="stable")
        points, costs = points[ranking], costs[ranking]
        self._elite_x, self._elite_costs = points[: self._elites], costs[: self._elites]

        n = self._crossed
        expected = expected_children(len(points), 2 * n + self._mutants)
        parents = self._rng.permutation(stochastic_uniform(expected, self._rng))
        return np.concatenate(
            [
                scattered(points[parents[:n]], points[parents[n : 2 * n]], self._rng),
                mutated(points[parents[2 * n :]], self._step, self._rng),
            ]
        )


def expected_children(population: int, parents: int) -> Array:
    """Return the expected number of selections of each individual as a parent, ``(population,)``.

    The numbers are proportional to 1 / sqrt(rank), with the best individual first. Their sum is
    ``parents``.
    """
    share = 1.0 / np.sqrt(np.arange(1, population + 1))
    return parents * share / np.sum(share)


def stochastic_uniform(expected: Array, rng: "np.random.Generator") -> NDArray[np.intp]:
    """Return the indices of selected individuals; each appears ``expected`` times, up to rounding.

    The expected numbers are intervals laid end to end. Marks at a distance of 1, with a random
    offset, select the individuals (Baker 1987, "Reducing bias and inefficiency in the selection
    algorithm"). The indices are in ascending order; their number is the sum of ``expected``.
    """
    marks = rng.random() + np.arange(round(np.sum(expected)))
    # The last end is omitted, because rounding may place it below the last mark.
    return np.searchsorted(np.cumsum(expected[:-1]), marks, side="right")


def scattered(mothers: Array, fathers: Array, rng: "np.random.Generator") -> Array:
    """Return children, ``(m, d)``, that take each gene at random from one of their parents."""
    return np.where(rng.random(mothers.shape) < 0.5, mothers, fathers)


def mutated(parents: Array, step: float, rng: "np.random.Generator") -> Array:
    """Return mutants, ``(m, d)``, at a distance ``step`` from their parents, clipped to the box."""
    directions = rng.normal(size=parents.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.clip(parents + step * directions, 0.0, 1.0)
