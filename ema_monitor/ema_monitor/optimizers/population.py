"""What optimizers with a population have in common."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from ema_core.arrays import Array
from ema_monitor.optimizers.interface import NO_HINTS, Hints


class Population(ABC):
    """A population spread uniformly over the unit box, but for its first individual.

    Parameters
    ----------
    start, rng, hints
        As of ``interface.Optimizer``.
    population
        Number of individuals, at least `FEWEST`.

    Raises
    ------
    ValueError
        When there are too few individuals.
    """

    FEWEST: ClassVar = 1
    """Smallest number of individuals with which the algorithm works."""

    uses_residuals = False
    converged = False

    def __init__(
        self,
        start: Array,
        rng: "np.random.Generator",
        hints: Hints = NO_HINTS,
        *,
        population: int = 50,
    ) -> None:
        if population < self.FEWEST:
            raise ValueError(
                f"population = {population} individuals: expected at least {self.FEWEST}"
            )
        self._rng = rng
        self._generations = max(1, hints.budget // population)
        self._asked = rng.random((population, len(start)))
        self._asked[0] = start
        self._begin(population, len(start))

    def ask(self) -> Array:
        """Return the first population, then its successors, ``(m, d)``."""
        return self._asked.copy()

    def tell(self, points: Array, costs: Array, residuals: Array) -> None:
        """Process the costs of the points, ``(m,)``, and make the next ones."""
        self._asked = self._next(points, costs)

    @abstractmethod
    def _begin(self, population: int, d: int) -> None:
        """Prepare for so many individuals in so many dimensions."""

    @abstractmethod
    def _next(self, points: Array, costs: Array) -> Array:
        """Return the points to evaluate next, ``(m, d)``, after the costs of these, ``(m,)``."""
