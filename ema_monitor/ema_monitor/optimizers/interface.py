"""What every optimizer offers: ask for points of the unit box, be told what they cost."""

from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class Hints(NamedTuple):
    """What is known of a problem beforehand; an optimizer may use it or not.

    Attributes
    ----------
    good_cost
        Highest cost at which an optimum may be believed to be the best.
    budget
        Evaluations that the search may take: what a schedule is spread over. It is the driver that
        ends the search.
    """

    good_cost: float = 0.0
    budget: int = 10_000


NO_HINTS: Final = Hints()
"""Nothing known: no cost is good enough, and the budget is that of the thesis, 200 x 50."""


class Optimizer(Protocol):
    """An optimizer on the unit box, with ask and tell.

    Further settings are keywords, so that a name in the registry is enough to make one.

    Parameters
    ----------
    start
        A point to start from or to know about, ``(d,)``, d at least 1. In a population one
        individual starts here, the others anywhere; for a wholly random population, make the
        start a random point of the box.
    rng
        Source of all its random numbers.
    hints
        What is known of the problem.

    Attributes
    ----------
    uses_residuals
        Whether it looks at the residuals rather than at the cost alone. Such an optimizer wants
        coordinates in which the residuals are smooth.
    converged
        True once nothing is left to ask.
    """

    uses_residuals: bool
    converged: bool

    def __init__(
        self, start: NDArray[np.float64], rng: np.random.Generator, hints: Hints = NO_HINTS
    ) -> None: ...

    def ask(self) -> NDArray[np.float64]:
        """Return the points to evaluate next, ``(m, d)``, each within [0, 1]."""
        ...

    def tell(
        self,
        points: NDArray[np.float64],
        costs: NDArray[np.float64],
        residuals: NDArray[np.float64],
    ) -> None:
        """Take the answers to the points asked for.

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
