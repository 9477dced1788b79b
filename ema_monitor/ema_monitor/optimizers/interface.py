# SPDX-License-Identifier: Apache-2.0
"""Interface of the optimizers: ``ask`` for points of the unit box, then ``tell`` their costs."""

from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

import numpy as np

from ema_core.arrays import Array


class Hints(NamedTuple):
    """Prior knowledge of a problem, which an optimizer may use."""

    good_cost: float = 0.0
    """Highest cost at which an optimum is accepted as global."""
    fair_cost: Callable[[], float] = float
    """Function that returns the highest cost at which an optimum is accepted if a second search has
    not improved it."""
    budget: int = 10_000
    """Largest number of evaluations, on which an algorithm may base its schedule. The driver ends
    the search."""


NO_HINTS: Final = Hints()
"""No prior knowledge; the budget of the thesis, 200 x 50."""


class Optimizer(Protocol):
    """Optimizer of a cost on the unit box, with the methods ``ask`` and ``tell``.

    Further settings of an algorithm are keyword arguments with defaults.

    Parameters
    ----------
    start
        Starting point, ``(d,)``, d at least 1. In a population, one individual starts here, all
        others at random points. For an entirely random population, pass a random point.
    rng
        Source of all random numbers.
    hints
        Prior knowledge of the problem.
    """

    uses_residuals: bool
    """Whether the algorithm uses residuals in addition to the cost, and therefore requires
    coordinates in which the residuals are smooth."""
    converged: bool
    """Whether the search has converged and needs no more evaluations."""

    def __init__(
        self, start: Array, rng: "np.random.Generator", hints: Hints = NO_HINTS
    ) -> None: ...

    def ask(self) -> Array:
        """Return the points to evaluate next, ``(m, d)``, each within [0, 1]."""
        ...

    def tell(self, points: Array, costs: Array, residuals: Array) -> None:
        """Process the costs of the points returned by ``ask``.

        Parameters
        ----------
        points
            The points, ``(m, d)``, as returned by ``ask``.
        costs
            Sum of squared residuals at each point, ``(m,)``; inf if it is not finite.
        residuals
            Residuals at each point, ``(m, n)``.
        """
        ...
