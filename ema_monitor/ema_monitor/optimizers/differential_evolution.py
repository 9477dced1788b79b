# SPDX-License-Identifier: Apache-2.0
"""Differential evolution (DE/best/1/bin): the standard form and the form of the thesis."""

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array
from ema_monitor.optimizers.interface import NO_HINTS, Hints
from ema_monitor.optimizers.population import Population


class DifferentialEvolution(Population):
    """Differential evolution, DE/best/1/bin.

    The donor for each individual (the target) is the best individual plus F times the difference
    between two partners, which differ from each other and from the target. A component of a donor
    outside the box bounces back to a random value between the best individual and the wall. The
    trial point takes each component from the donor with probability CR, but at least one component,
    and the remaining components from the target. It replaces the target if its cost is lower.

    Parameters
    ----------
    start, rng, hints, population
        See `Population`.
    F
        Weight of the difference, above 0 [-].
    CR
        Crossover probability, from 0 to 1 [-].

    References
    ----------
    Storn and Price (1997), "Differential evolution - a simple and efficient heuristic for global
    optimization over continuous spaces", Journal of Global Optimization 11.
    Price, Storn and Lampinen (2005), "Differential Evolution", Springer; bounce-back: section
    4.3.1.
    """

    # A target and two partners.
    FEWEST = 3

    def __init__(
        self,
        start: Array,
        rng: "np.random.Generator",
        hints: Hints = NO_HINTS,
        *,
        population: int = 50,
        F: float = 0.9,
        CR: float = 0.95,
    ) -> None:
        super().__init__(start, rng, hints, population=population)
        self._F = F
        self._CR = CR

    def _begin(self, population: int, d: int) -> None:
        self._x = self._asked
        self._costs = np.full(population, np.inf)

    def _next(self, points: Array, costs: Array) -> Array:
        better = costs < self._costs
        self._x[better] = points[better]
        self._costs[better] = costs[better]

        n, d = self._x.shape
        best = self._x[np.argmin(self._costs)]
        first, second = self._partners()
        donors = self._into_box(best + self._F * (self._x[first] - self._x[second]), best)
        from_donor = self._rng.random((n, d)) < self._CR
        from_donor[np.arange(n), self._rng.integers(d, size=n)] = True
        return np.where(from_donor, donors, self._x)

    def _partners(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the indices of two partners for each target, ``(n,)`` each.

        The target and its partners are three different individuals.
        """
        n = len(self._x)
        ahead = self._rng.integers(1, n, size=n)
        further = self._rng.integers(1, n - 1, size=n)
        further += further >= ahead
        targets = np.arange(n)
        return (targets + ahead) % n, (targets + further) % n

    def _into_box(self, donors: Array, best: Array) -> Array:
        wall = np.clip(donors, 0.0, 1.0)
        bounced = best + self._rng.random(donors.shape) * (wall - best)
        return np.where(donors == wall, donors, bounced)


class ThesisDifferentialEvolution(DifferentialEvolution):
    """Differential evolution, DE/best/1/bin, as in the thesis, appendix A.

    It differs from `DifferentialEvolution` in two ways. The partners come from two independent
    permutations of the population: a partner may be the target, and if both partners are the same,
    the donor is the best individual. The donor is reflected at 0. The thesis does not limit it
    above; here it is clipped to 1, because a fault above 1 has no meaning.

    Parameters
    ----------
    start, rng, hints, population, F, CR
        See `DifferentialEvolution`.
    """

    def _partners(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        n = len(self._x)
        return self._rng.permutation(n), self._rng.permutation(n)

    def _into_box(self, donors: Array, best: Array) -> Array:
        return np.minimum(np.abs(donors), 1.0)
