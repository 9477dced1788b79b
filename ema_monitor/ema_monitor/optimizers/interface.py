"""Interface of the optimizers: ask for points of the unit box, then tell their costs."""

from collections.abc import Callable
from typing import Final, NamedTuple, Protocol

import numpy as np

from ema_core.arrays import Array


class Hints(NamedTuple):
    """Prior knowledge of a problem, which an optimizer may use.

    Attributes
    ----------
    good_cost
        Highest cost at which an optimum can be accepted as the global one.
    fair_cost
        Returns the highest cost at which it can be accepted once a second search has found nothing
        better.
    budget
        Largest number of evaluations, over which a schedule extends. The driver ends the search.
    """

    good_cost: float = 0.0
    fair_cost: Callable[[], float] = float
    budget: int = 10_000


NO_HINTS: Final = Hints()
"""No prior knowledge; the budget is the thesis's, 200 x 50."""


class Optimizer(Protocol):
    """An optimizer on the unit box, with ask and tell.

    Further settings are keywords with defaults.

    Parameters
    ----------
    start
        Starting point, ``(d,)``, d at least 1. In a population one individual starts here, the
        others at random points; for an entirely random population, pass a random point.
    rng
        Source of all its random numbers.
    hints
        Prior knowledge of the problem.

    Attributes
    ----------
    uses_residuals
        Whether it uses the residuals and not only the cost. It then requires coordinates in which
        the residuals are smooth.
    converged
        Whether the search has converged, so that there are no more points to evaluate.
    """

    uses_residuals: bool
    converged: bool

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
            Sum of squares of the residuals of each point, ``(m,)``; inf where it has none.
        residuals
            Residuals of each point, ``(m, n)``.
        """
        ...
