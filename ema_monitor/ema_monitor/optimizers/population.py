# SPDX-License-Identifier: Apache-2.0
"""Base class of population-based optimizers."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from ema_core.arrays import Array
from ema_monitor.optimizers.interface import NO_HINTS, Hints


class Population(ABC):
    """Base class of population-based optimizers.

    The first population consists of the start and uniformly distributed points in the unit box.

    Parameters
    ----------
    start
        Starting point, ``(d,)``, which is the first individual.
    rng
        Source of all random numbers.
    hints
        Prior knowledge of the problem. Schedules extend over the budget.
    population
        Number of individuals, at least `FEWEST`.

    Raises
    ------
    ValueError
        If there are too few individuals.
    """

    FEWEST: ClassVar = 1
    """Smallest population with which the algorithm works."""

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
        """Return the individuals to evaluate next, ``(m, d)``."""
        return self._asked.copy()

    def tell(self, points: Array, costs: Array, residuals: Array) -> None:
        """Process the costs, ``(m,)``, of the points, and compute the next generation."""
        self._asked = self._next(points, costs)

    @abstractmethod
    def _begin(self, population: int, d: int) -> None:
        """Initialise the state for ``population`` individuals in ``d`` dimensions."""

    @abstractmethod
    def _next(self, points: Array, costs: Array) -> Array:
        """Return the next points, ``(m, d)``, from evaluated points and their costs, ``(m,)``."""
