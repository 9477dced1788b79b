"""Particle swarm optimization in its canonical form."""

import numpy as np
from numpy.typing import NDArray


class ParticleSwarm:
    """Global-best particle swarm with constriction.

    Inertia and accelerations are those of Clerc and Kennedy (2002), IEEE Trans. Evol. Comput.
    6(1): inertia 0.7298, both accelerations 1.49618. A particle that leaves the box is put on the
    wall and its velocity across the wall is set to zero.

    Parameters
    ----------
    start
        A point that one particle starts from, ``(d,)``; the others start anywhere.
    rng
        Source of random numbers.
    particles
        Size of the swarm.
    """

    uses_residuals = False
    converged = False

    inertia = 0.7298
    acceleration = 1.49618

    def __init__(
        self, start: NDArray[np.float64], rng: np.random.Generator, particles: int = 50
    ) -> None:
        self._rng = rng
        d = len(start)
        self._x = rng.random((particles, d))
        self._x[0] = start
        self._v = rng.uniform(-0.5, 0.5, (particles, d))
        self._best_x = self._x.copy()
        self._best_cost = np.full(particles, np.inf)

    def ask(self) -> NDArray[np.float64]:
        """Return the particles' positions, ``(particles, d)``."""
        return self._x.copy()

    def tell(
        self,
        points: NDArray[np.float64],
        costs: NDArray[np.float64],
        residuals: NDArray[np.float64],
    ) -> None:
        """Move the particles after their costs, ``(particles,)``."""
        better = costs < self._best_cost
        self._best_cost[better] = costs[better]
        self._best_x[better] = points[better]
        leader = self._best_x[np.argmin(self._best_cost)]
        to_own, to_leader = self._rng.random((2, *points.shape))
        self._v = self.inertia * self._v + self.acceleration * (
            to_own * (self._best_x - points) + to_leader * (leader - points)
        )
        moved = points + self._v
        self._x = np.clip(moved, 0.0, 1.0)
        self._v[self._x != moved] = 0.0
