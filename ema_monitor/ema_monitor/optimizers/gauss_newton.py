# SPDX-License-Identifier: Apache-2.0
"""Gauss-Newton descents with exchangeable trial steps and termination.

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

    A group is evaluated in one batch, and only if no earlier group reduces the cost. ``full`` is
    the index of the full step in the first group. The full step leads to the minimum of the linear
    model.
    """

    groups: Sequence[Array]
    full: int


class Search(Protocol):
    """Rule for the trial points of a descent."""

    def trials(self, at: Linearisation) -> Trials:
        """Return the trial points for a linearisation."""
        ...

    def after(self, number: int) -> Self:
        """Return the rule for the next iteration.

        ``number`` is the index, within its group, of the trial with the lowest cost.
        """
        ...


class LineSearch(NamedTuple):
    """Line search along the step to the minimum of the linear model.

    ``lowest`` returns the minimiser of the model, ``(d,)``. ``groups`` contains the fractions of
    the step to try, in groups: a group is evaluated in one batch, and only if no earlier group
    reduces the cost. The first fraction of the first group must be 1, the full step, because it is
    accepted near the optimum (J. Nocedal, S. Wright, Numerical Optimization, 2006, section 3.1).
    """

    lowest: Callable[[Linearisation], Array]
    groups: Sequence[Sequence[float]]

    def trials(self, at: Linearisation) -> Trials:
        """Return points on the line from the linearisation point to the minimum of its model."""
        step = self.lowest(at) - at.point
        return Trials([at.point + np.array(group)[:, None] * step for group in self.groups], 0)

    def after(self, number: int) -> Self:
        """Return the same rule: every iteration tries the full step first."""
        return self


class LevenbergMarquardt(NamedTuple):
    """Levenberg-Marquardt steps within the unit box, with several dampings and nearly undamped."""

    damping: float = 2.0
    """Damping relative to the diagonal of the normal matrix [-]."""

    def trials(self, at: Linearisation) -> Trials:
        """Return the end points of the damped steps, the step with minimal damping last."""
        quadratic = Quadratic.of(at)
        dampings = [*(self.damping * factor for factor in FACTORS), LEAST_DAMPING]
        points = [quadratic.damped(damping).lowest() for damping in dampings]
        return Trials([np.stack(points)], len(FACTORS))

    def after(self, number: int) -> Self:
        """Return the rule for the next iteration, with dampings near the best damping.

        If the step with minimal damping was the best, the damping decreases by the factor 0.3.
        """
        damping = self.damping * FACTORS[min(number, len(FACTORS) - 1)]
        return self._replace(damping=min(max(damping, LEAST_DAMPING), MOST_DAMPING))


FACTORS: Final = (2.0, 0.3)
"""Trial dampings, relative to the best damping of the previous iteration [-].

Marquardt uses 10 and 0.1. On 40 windows of random units, 10 and 0.1 require as many evaluations but
change 4 estimates by 0.1 sigma; 4 and 0.25 require 1 % fewer evaluations. An initial damping of 0.2
requires 4 % more, an initial damping of 20 requires 2 % more."""

LEAST_DAMPING: Final = 1e-6
"""Minimal damping [-]: far above the rounding errors of the normal matrix, and too small to change
a step."""

MOST_DAMPING: Final = 30.0
"""Largest damping [-]. With more damping, steps are too short to improve. On the same windows,
limits of 10 and 300 give the same estimates."""


class Stopping(NamedTuple):
    """Termination rule of a descent."""

    iterations: int
    """Largest number of steps."""
    gain: float = 0.0
    """A step is taken only if its gain, relative to the cost, is larger [-]."""
    step: Array | float = 0.0
    """The descent ends after a step that is shorter in every component, ``(d,)``."""
    promise: float = 0.0
    """Smallest predicted gain of a full step at which the descent continues, relative to the cost
    [-]. The descent also ends if the full step is taken, the fit is good, and the cost agrees with
    the prediction within this share."""
    good_cost: float = 0.0
    """Highest cost of a good fit."""


_NOWHERE: Final = Linearisation(np.empty(0), np.empty(0), np.empty((0, 0)))


@dataclass
class Descent:
    """State of a descent from a starting point."""

    point: Array
    """Current point, ``(d,)``."""
    cost: float
    """Cost at the current point."""
    residuals: Array
    """Residuals at the current point, ``(r,)``."""
    search: Search
    """Rule for the trial points."""
    stopping: Stopping
    """Termination rule."""
    at: Linearisation = _NOWHERE
    """Latest linearisation, at the current or the previous point."""
    iterations: int = 0
    done: bool = False
    _full: int = 0
    _promised: float = np.inf

    @property
    def is_linearised(self) -> bool:
        """Whether the latest linearisation is at the current point."""
        return self.at.point is self.point

    def trials(self) -> Sequence[Array]:
        """Return the trial points for the linearisation at the current point, in groups.

        If the predicted gain of the full step is negligible, the full step is the only and last
        trial.
        """
        at = self.at
        groups, self._full = self.search.trials(at)
        full = groups[0][self._full]
        self.iterations += 1
        self._promised = at.predicted_cost(full)
        self.done = self._promised > (1.0 - self.stopping.promise) * self.cost
        return [full[None]] if self.done else groups

    def accept(self, trials: Array, costs: Array, residuals: Array) -> bool:
        """Move to the best trial point if its gain is large enough; return whether it moved.

        ``done`` is set if the step meets a condition of `Stopping`.
        """
        stopping, best = self.stopping, int(np.argmin(costs))
        cost = float(costs[best])
        self.search = self.search.after(best)
        if not self.cost - cost > stopping.gain * self.cost:
            return False
        if best == self._full:
            is_as_predicted = abs(cost - self._promised) < stopping.promise * cost
            self.done |= is_as_predicted and cost <= stopping.good_cost
        self.done |= bool(np.all(np.abs(trials[best] - self.point) < stopping.step))
        self.done |= self.iterations >= stopping.iterations
        self.point, self.cost, self.residuals = trials[best], cost, residuals[best]
        return True


class LeastSquaresProblem(NamedTuple):
    """Least-squares problem.

    ``residuals`` returns the residuals, ``(m, r)``, at points, ``(m, d)``. ``linearise`` returns
    their linearisation at a point, ``(d,)``.
    """

    residuals: Callable[[Array], Array]
    linearise: Callable[[Array], Linearisation]


def descend(
    problem: LeastSquaresProblem, starts: Array, search: Search, stopping: Stopping
) -> Descent:
    """Return the finished descent from the best of several starts, ``(m, d)``.

    The descent ends early if the cost of the best start or a derivative is not finite.
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


def _evaluated(problem: LeastSquaresProblem, points: Array) -> tuple[Array, Array]:
    """Return the residuals, ``(m, r)``, and costs, ``(m,)``, at points, ``(m, d)``.

    The cost is inf if a residual is not finite.
    """
    residuals = problem.residuals(points)
    costs = np.einsum("ij,ij->i", residuals, residuals)
    costs[~np.isfinite(costs)] = np.inf
    return residuals, costs
