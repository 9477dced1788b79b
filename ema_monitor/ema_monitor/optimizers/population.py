"""What optimizers with a population have in common."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

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
        start: NDArray[np.float64],
        rng: np.random.Generator,
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

    def ask(self) -> NDArray[np.float64]:
        """Return the first population, then what was made of it, ``(m, d)``."""
        return self._asked.copy()

    def tell(
        self,
        points: NDArray[np.float64],
        costs: NDArray[np.float64],
        residuals: NDArray[np.float64],
    ) -> None:
        """Process the costs of the points, ``(m,)``, and make the next ones."""
        self._asked = self._next(points, costs)

    @abstractmethod
    def _begin(self, population: int, d: int) -> None:
        """Prepare for so many individuals in so many dimensions."""

    @abstractmethod
    def _next(self, points: NDArray[np.float64], costs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the points to evaluate next, ``(m, d)``, after the costs of these, ``(m,)``."""
