"""What every optimizer offers: ask for points of the unit box, be told what they cost."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Optimizer(Protocol):
    """An optimizer on the unit box, with ask and tell.

    Parameters
    ----------
    start
        A point to start from or to know about, ``(d,)``.
    rng
        Source of all its random numbers.

    Attributes
    ----------
    uses_residuals
        Whether it looks at the residuals rather than at the cost alone. Such an optimizer wants
        coordinates in which the residuals are smooth, and takes a ``good_cost``, the highest cost
        at which it may believe an optimum.
    converged
        True once nothing is left to ask.
    """

    uses_residuals: bool
    converged: bool

    def __init__(self, start: NDArray[np.float64], rng: np.random.Generator) -> None: ...

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
