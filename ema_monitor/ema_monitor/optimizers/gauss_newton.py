"""Gauss-Newton descents, with separate trial steps, descent and termination.

An iteration linearises the residuals, evaluates the trial steps of a `Search`, takes the step with
the lowest cost, and checks `Stopping`. Descent, search and termination are separate as in
optimistix (J. Rader, T. Lyons, P. Kidger, arXiv:2402.09983, 2024).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol, Self

import numpy as np

from ema_core.arrays import Array
from ema_monitor.optimizers.linear_model import Linearisation, Quadratic


class Trials(NamedTuple):
    """Trial points in groups, ``(m, d)`` each.

    A group is evaluated in one batch, and only if no earlier group reduces the cost. Number
    ``full`` of the first group is the minimum of the linear model.
    """

    groups: Sequence[Array]
    full: int


class Search(Protocol):
    """Rule for the trial points of a descent."""

    def trials(self, at: Linearisation) -> Trials:
        """Return the trial points for a linearisation."""
        ...

    def after(self, number: int) -> Self:
        """Return the search of the next iteration, if trial ``number`` has the lowest cost."""
        ...


class LineSearch(NamedTuple):
    """Shares of the step to the minimum of the linear model.

    J. Nocedal, S. Wright, Numerical Optimization, 2006, section 3.1: the full step is tried first,
    and is accepted near the optimum.
    """

    lowest: Callable[[Linearisation], Array]
    groups: Sequence[Sequence[float]]

    def trials(self, at: Linearisation) -> Trials:
        """Return points between the point of a linearisation and the minimum of its model."""
        step = self.lowest(at) - at.point
        return Trials([at.point + np.array(group)[:, None] * step for group in self.groups], 0)

    def after(self, number: int) -> Self:
        """Return the same search: every iteration tries the full step first."""
        return self


class LevenbergMarquardt(NamedTuple):
    """Damped steps within the unit box, and a step with minimal damping."""

    damping: float = 2.0
    """Damping relative to the diagonal of the normal matrix [-]."""

    def trials(self, at: Linearisation) -> Trials:
        """Return the ends of steps with several dampings, minimal damping last."""
        quadratic = Quadratic.of(at)
        dampings = [*(self.damping * factor for factor in FACTORS), LEAST_DAMPING]
        points = [quadratic.damped(damping).lowest() for damping in dampings]
        return Trials([np.stack(points)], len(FACTORS))

    def after(self, number: int) -> Self:
        """Return the search about the best damping."""
        damping = self.damping * FACTORS[min(number, len(FACTORS) - 1)]
        return self._replace(damping=min(max(damping, LEAST_DAMPING), MOST_DAMPING))


FACTORS: Final = (2.0, 0.3)
"""Trial dampings, relative to the best damping of the previous iteration [-].

Marquardt uses 10 and 0.1. On 40 windows of drawn units, 10 and 0.1 take as many evaluations but
move 4 estimates by 0.1 sigma, and 4 and 0.25 take 1 % fewer. A first damping of 0.2 takes 4 % more,
a first damping of 20 takes 2 % more."""

LEAST_DAMPING: Final = 1e-6
"""Minimal damping [-]: far above the rounding of the normal matrix, and too small to change a
step."""

MOST_DAMPING: Final = 30.0
"""Largest damping [-]; with more, steps are too short to improve. On the same windows, limits of 10
and 300 give the same estimates."""


class Stopping(NamedTuple):
    """Termination of a descent."""

    iterations: int
    """Largest number of steps."""
    gain: float = 0.0
    """Least gain of a step that is taken, as a share of the cost [-]."""
    step: Array | float = 0.0
    """Largest length of the last step, in each component, ``(d,)``."""
    promise: float = 0.0
    """Least gain of a full step that the linear model predicts, as a share of the cost [-]. The
    step is the last one if the predicted gain is smaller, or if the fit is good and the actual cost
    agrees with the prediction within this share."""
    good_cost: float = 0.0
    """Highest cost of a good fit."""


_NOWHERE: Final = Linearisation(np.empty(0), np.empty(0), np.empty((0, 0)))


@dataclass
class Descent:
    """State of a descent from one start."""

    point: Array
    """Present point, ``(d,)``."""
    cost: float
    """Cost of the present point."""
    residuals: Array
    """Residuals at the present point, ``(r,)``."""
    search: Search
    """Rule for the trial points."""
    stopping: Stopping
    """Rule for the end."""
    at: Linearisation = _NOWHERE
    """Latest linearisation, at the present or the previous point."""
    iterations: int = 0
    done: bool = False
    _full: int = 0
    _promised: float = np.inf

    @property
    def is_linearised(self) -> bool:
        """Whether the latest linearisation is at the point."""
        return self.at.point is self.point

    def trials(self) -> Sequence[Array]:
        """Return the trial points for the linearisation at the point, in groups.

        If the predicted gain of the full step is negligible, it is the only trial, and the last.
        """
        at = self.at
        groups, self._full = self.search.trials(at)
        full = groups[0][self._full]
        self.iterations += 1
        self._promised = at.predicted_cost(full)
        self.done = self._promised > (1.0 - self.stopping.promise) * self.cost
        return [full[None]] if self.done else groups

    def accept(self, trials: Array, costs: Array, residuals: Array) -> bool:
        """Move to the best trial if its gain is large enough; return whether it is."""
        stopping, best = self.stopping, int(np.argmin(costs))
        cost = float(costs[best])
        self.search = self.search.after(best)
        if not self.cost - cost > stopping.gain * self.cost:
            return False
        if best == self._full:
            is_kept = abs(cost - self._promised) < stopping.promise * cost
            self.done |= is_kept and cost <= stopping.good_cost
        self.done |= bool(np.all(np.abs(trials[best] - self.point) < stopping.step))
        self.done |= self.iterations >= stopping.iterations
        self.point, self.cost, self.residuals = trials[best], cost, residuals[best]
        return True


class Problem(NamedTuple):
    """Residuals, ``(m, r)``, of points, ``(m, d)``, and their linearisation at a point."""

    residuals: Callable[[Array], Array]
    linearise: Callable[[Array], Linearisation]


def descend(problem: Problem, starts: Array, search: Search, stopping: Stopping) -> Descent:
    """Return a finished descent from the best of several starts, ``(m, d)``.

    It ends early if a derivative is not finite.
    """
    residuals, costs = _evaluated(problem, starts)
    first = int(np.argmin(costs))
    descent = Descent(starts[first], float(costs[first]), residuals[first], search, stopping)
    descent.done = not np.isfinite(descent.cost)
    while not descent.done:
        descent.at = at = problem.linearise(descent.point)
        if not at.is_finite:
            break
        # A problem may change the weights of its residuals at each linearisation.
        descent.cost = at.cost
        groups = descent.trials()
        if not any(descent.accept(group, *_evaluated(problem, group)[::-1]) for group in groups):
            break
    return descent


def _evaluated(problem: Problem, points: Array) -> tuple[Array, Array]:
    """Return residuals, ``(m, r)``, and costs, ``(m,)``; inf if a residual is not finite."""
    residuals = problem.residuals(points)
    costs = np.einsum("ij,ij->i", residuals, residuals)
    costs[~np.isfinite(costs)] = np.inf
    return residuals, costs
