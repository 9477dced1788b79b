"""Standard test functions on the unit box, the least cost 0 of each away from centre and corners.

The width of their usual range is the side of the box, 10.24 for example. Sphere, ellipsoid,
Rastrigin and Ackley are sums over the components, which favours methods that change one at a time.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

D: Final = 8

_rng = np.random.default_rng(2018)
# Each component 0.1 to 0.3 off the centre, to either side.
OPTIMUM: Final = 0.5 + _rng.choice([-1.0, 1.0], D) * _rng.uniform(0.1, 0.3, D)


class StandardFunction(NamedTuple):
    """A function on the unit box and the value that counts as found."""

    values: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    """Maps points, ``(m, d)``, to their costs, ``(m,)``."""
    target: float


def _away(points: NDArray[np.float64], side: float) -> NDArray[np.float64]:
    return side * (points - OPTIMUM)


def sphere(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared distance on [-5.12, 5.12]."""
    return np.sum(_away(points, 10.24) ** 2, axis=1)


def ellipsoid(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weighted squared distance on [-5.12, 5.12], of condition 1e3."""
    return _away(points, 10.24) ** 2 @ np.geomspace(1.0, 1e3, D)


def rosenbrock(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rosenbrock's curved valley on a range of 4.096; components depend on each other."""
    z = 1.0 + _away(points, 4.096)
    return np.sum(100.0 * (z[:, 1:] - z[:, :-1] ** 2) ** 2 + (1.0 - z[:, :-1]) ** 2, axis=1)


def rastrigin(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rastrigin's function on a range of 10.24: some 10 minima along each axis."""
    y = _away(points, 10.24)
    return np.sum(y**2 + 10.0 * (1.0 - np.cos(2.0 * np.pi * y)), axis=1)


def ackley(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ackley's function on a range of 65.536: a narrow funnel in a rippled plain."""
    y = _away(points, 65.536)
    funnel = 20.0 * (1.0 - np.exp(-0.2 * np.sqrt(np.mean(y**2, axis=1))))
    # The mean of cosines is 1 at the optimum up to rounding, which must not make the cost negative.
    ripple = np.e - np.exp(np.mean(np.cos(2.0 * np.pi * y), axis=1))
    return np.maximum(funnel + ripple, 0.0)


def griewank(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Griewank's function on a range of 1200: a wide bowl with a product of waves on it."""
    y = _away(points, 1200.0)
    waves = np.prod(np.cos(y / np.sqrt(np.arange(1.0, D + 1.0))), axis=1)
    return np.sum(y**2, axis=1) / 4000.0 + 1.0 - waves


# Targets that genetic algorithms and grey wolves, which home in slowly, reach in 20,000 evaluations
# at least now and then. Of sphere, ellipsoid and Ackley they are in the valley of the best minimum
# (Ackley's next ones cost more than 1.2). Of Rosenbrock, Rastrigin (about 1 for each step away in
# each component) and Griewank some other minima will do: they ask for a good one.
FUNCTIONS: Final[dict[str, StandardFunction]] = {
    "sphere": StandardFunction(sphere, 1e-2),
    "ellipsoid": StandardFunction(ellipsoid, 10.0),
    "rosenbrock": StandardFunction(rosenbrock, 8.0),
    "rastrigin": StandardFunction(rastrigin, 10.0),
    "ackley": StandardFunction(ackley, 1.0),
    "griewank": StandardFunction(griewank, 0.5),
}
