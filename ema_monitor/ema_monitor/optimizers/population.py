"""What optimizers with a population have in common."""

import numpy as np
from numpy.typing import NDArray


class Population:
    """A population spread uniformly over the unit box, but for its first individual.

    Parameters
    ----------
    start
        Where the first individual is, ``(d,)``.
    rng
        Source of random numbers.
    population
        Number of individuals.
    fewest
        Smallest number with which the algorithm works.

    Raises
    ------
    ValueError
        When the population is too small.
    """

    uses_residuals = False
    converged = False

    def __init__(
        self, start: NDArray[np.float64], rng: np.random.Generator, population: int, fewest: int
    ) -> None:
        if population < fewest:
            raise ValueError(f"population = {population} individuals: expected at least {fewest}")
        self._rng = rng
        self._asked = rng.random((population, len(start)))
        self._asked[0] = start

    def ask(self) -> NDArray[np.float64]:
        """Return the first population, then what `tell` has made of it, ``(m, d)``."""
        return self._asked.copy()
