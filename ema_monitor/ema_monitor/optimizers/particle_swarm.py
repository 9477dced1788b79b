# SPDX-License-Identifier: Apache-2.0
"""Particle swarm optimization with adaptive inertia and random neighbourhoods."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array
from ema_monitor.optimizers.population import Population

_FEWEST_NEIGHBOURS: Final = 2
_NEIGHBOUR_FRACTION: Final = 0.25
_INERTIA_RANGE: Final = (0.1, 1.1)
_SELF_ADJUSTMENT: Final = 1.49
_SOCIAL_ADJUSTMENT: Final = 1.49


class ParticleSwarm(Population):
    """Particle swarm optimizer, after the documentation of Matlab's ``particleswarm``.

    Each particle is attracted by the best point on its own path, and by the best point on the paths
    of its neighbours. In each iteration, new neighbours are drawn for each particle. Their number
    is initially a quarter of the swarm, at least 2. If the best cost does not decrease in an
    iteration, the number increases by the initial number, up to all other particles, and a stall
    counter is incremented. If the best cost decreases, the number is reset, and the counter is
    decremented, at least to 0. The inertia is initially 1.1. It is doubled while the counter is
    below 2 and halved while the counter is above 5, within [0.1, 1.1]. Particles that leave the box
    are clipped to it, and lose the velocity component across the wall.

    In the documentation, the inertia changes only in iterations in which the best cost decreases.
    Here it changes in all iterations: a swarm with an inertia of 1.1 does not contract and seldom
    improves, so that its inertia would remain at 1.1.

    Parameters, defaults and errors are as in `Population`.

    References
    ----------
    MathWorks, "Particle swarm optimization algorithm", Global Optimization Toolbox,
    https://www.mathworks.com/help/gads/particle-swarm-optimization-algorithm.html.
    Mezura-Montes and Coello Coello (2011), "Constraint-handling in nature-inspired numerical
    optimization", Swarm and Evolutionary Computation 1(4).
    Pedersen (2010), "Good parameters for particle swarm optimization", Hvass Laboratories HL1001.
    """

    # A particle and two neighbours.
    FEWEST = 3

    def _begin(self, population: int, d: int) -> None:
        # Initial velocities, up to the width of the box per iteration.
        self._v = self._rng.uniform(-1.0, 1.0, self._asked.shape)
        self._best_x = self._asked.copy()
        self._best_costs = np.full(population, np.inf)
        self._fewest_neighbours = max(_FEWEST_NEIGHBOURS, int(population * _NEIGHBOUR_FRACTION))
        self._neighbours = self._fewest_neighbours
        self._inertia = _INERTIA_RANGE[1]
        self._stalls = 0

    def _next(self, points: Array, costs: Array) -> Array:
        self._adapt(improved=bool(np.min(costs) < np.min(self._best_costs)))
        better = costs < self._best_costs
        self._best_costs[better] = costs[better]
        self._best_x[better] = points[better]
        to_best, to_leader = self._rng.random((2, *points.shape))
        self._v = (
            self._inertia * self._v
            + _SELF_ADJUSTMENT * to_best * (self._best_x - points)
            + _SOCIAL_ADJUSTMENT * to_leader * (self._best_x[self._leaders()] - points)
        )
        moved = points + self._v
        asked = np.clip(moved, 0.0, 1.0)
        self._v[asked != moved] = 0.0
        return asked

    def _adapt(self, *, improved: bool) -> None:
        """Adapt the number of neighbours and the inertia; the first generation has no effect."""
        if improved:
            self._stalls = max(0, self._stalls - 1)
            self._neighbours = self._fewest_neighbours
        else:
            self._stalls += 1
            grown = self._neighbours + self._fewest_neighbours
            self._neighbours = min(grown, len(self._best_x) - 1)
        lowest, highest = _INERTIA_RANGE
        if self._stalls < 2:
            self._inertia = min(2.0 * self._inertia, highest)
        elif self._stalls > 5:
            self._inertia = max(0.5 * self._inertia, lowest)

    def _leaders(self) -> NDArray[np.intp]:
        """Return the index of the best neighbour of each particle, ``(n,)``."""
        n = len(self._best_x)
        keys = self._rng.random((n, n))
        np.fill_diagonal(keys, np.inf)
        neighbours = np.argpartition(keys, self._neighbours - 1, axis=1)[:, : self._neighbours]
        return neighbours[np.arange(n), np.argmin(self._best_costs[neighbours], axis=1)]
