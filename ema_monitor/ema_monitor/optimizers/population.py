"""The first generation of a population."""

import numpy as np
from numpy.typing import NDArray


def first_generation(
    start: NDArray[np.float64], rng: np.random.Generator, population: int, fewest: int
) -> NDArray[np.float64]:
    """Return a population spread uniformly over the unit box, but for its first individual.

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

    Returns
    -------
    numpy.ndarray
        The individuals, ``(population, d)``.

    Raises
    ------
    ValueError
        When the population is too small.
    """
    if population < fewest:
        raise ValueError(f"population = {population} individuals: expected at least {fewest}")
    points = rng.random((population, len(start)))
    points[0] = start
    return points
