"""Gauss-Newton descents: trial steps, the choice between them, and the end, each by itself.

An iteration linearises the residuals, tries the steps of a `Search`, takes the one that costs least
and asks `Stopping` whether to go on. Descent, search and termination are separate as in optimistix
(J. Rader, T. Lyons, P. Kidger, arXiv:2402.09983, 2024).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol, Self

import numpy as np

from ema_core.arrays import Array
from ema_monitor.optimizers.linear_model import Linearisation, Quadratic


class Trials(NamedTuple):
    """Points to try, in groups, ``(m, d)`` each.

    A group is evaluated in one batch, and only if no group before it lowers the cost. Number
    ``full`` of the first group is the lowest point of the linear model.
    """

    groups: Sequence[Array]
    full: int


class Search(Protocol):
    """Which points a descent tries."""

    def trials(self, at: Linearisation) -> Trials:
        """Return the points to try from a linearisation."""
        ...

    def after(self, number: int) -> Self:
        """Return the search of the next iteration, after trial ``number`` has cost least."""
        ...


class LineSearch(NamedTuple):
    """Shares of the step to the lowest point of the linear model.

    J. Nocedal, S. Wright, Numerical Optimization, 2006, section 3.1: the full step comes first,
    and is right near the optimum.
    """

    lowest: Callable[[Linearisation], Array]
    groups: Sequence[Sequence[float]]

    def trials(self, at: Linearisation) -> Trials:
        """Return points between that of a linearisation and the lowest one."""
        step = self.lowest(at) - at.point
        return Trials([at.point + np.array(group)[:, None] * step for group in self.groups], 0)

    def after(self, number: int) -> Self:
        """Return the same search: each step is tried in full."""
        return self


class LevenbergMarquardt(NamedTuple):
    """Damped steps within the unit box, and one that is hardly damped."""

    damping: float = 2.0
    """Relative to the diagonal of the normal matrix [-]."""

    def trials(self, at: Linearisation) -> Trials:
        """Return where steps under several dampings lead, the hardly damped one at last."""
        quadratic = Quadratic.of(at)
        dampings = [*(self.damping * factor for factor in FACTORS), LEAST_DAMPING]
        points = [quadratic.damped(damping).lowest() for damping in dampings]
        return Trials([np.stack(points)], len(FACTORS))

    def after(self, number: int) -> Self:
        """Return the search about the damping that was the best."""
        damping = self.damping * FACTORS[min(number, len(FACTORS) - 1)]
        return self._replace(damping=min(max(damping, LEAST_DAMPING), MOST_DAMPING))


FACTORS: Final = (2.0, 0.3)
"""Dampings that are tried, over the best one of the iteration before [-]."""

LEAST_DAMPING: Final = 1e-6
"""Damping of a step that is hardly damped [-]."""

MOST_DAMPING: Final = 30.0
"""Damping beyond which steps are too short to find anything [-]."""


class Stopping(NamedTuple):
    """When a descent ends."""

    iterations: int
    """Largest number of steps."""
    gain: float = 0.0
    """Share of the cost that a step has to gain to be taken [-]."""
    step: Array | float = 0.0
    """Length of the last step, in each component, ``(d,)``."""
    promise: float = 0.0
    """Share of the cost that a full step has to gain by the linear model [-]. It is the last one
    if it promises less, or gains what it promised, within this share, and the fit is good."""
    good_cost: float = 0.0
    """Highest cost of a good fit."""


_NOWHERE: Final = Linearisation(np.empty(0), np.empty(0), np.empty((0, 0)))


@dataclass
class Descent:
    """One start on its way down.

    Attributes
    ----------
    point, cost, residuals
        Where it stands, ``(d,)``, its cost, and the residuals there, ``(r,)``.
    search, stopping
        Which points to try next, and when to end.
    at
        The latest linearisation, which may be that of the point before.
    """

    point: Array
    cost: float
    residuals: Array
    search: Search
    stopping: Stopping
    at: Linearisation = _NOWHERE
    iterations: int = 0
    done: bool = False
    _full: int = 0
    _promised: float = np.inf

    @property
    def is_linearised(self) -> bool:
        """Whether the latest linearisation is at the point."""
        return self.at.point is self.point

    def trials(self) -> Sequence[Array]:
        """Return the points to try from the linearisation at the point, in groups.

        If the full step promises hardly anything it is the only one, and the descent is done.
        """
        at = self.at
        groups, self._full = self.search.trials(at)
        full = groups[0][self._full]
        self.iterations += 1
        self._promised = at.predicted_cost(full)
        self.done = self._promised > (1.0 - self.stopping.promise) * self.cost
        return [full[None]] if self.done else groups

    def accept(self, trials: Array, costs: Array, residuals: Array) -> bool:
        """Move to the lowest of some trials, and return whether it gains enough to do so."""
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
    """Return a finished descent from the lowest of some starts, ``(m, d)``.

    It ends early where a derivative is not finite.
    """
    residuals, costs = _evaluated(problem, starts)
    first = int(np.argmin(costs))
    descent = Descent(starts[first], float(costs[first]), residuals[first], search, stopping)
    descent.done = not np.isfinite(descent.cost)
    while not descent.done:
        descent.at = at = problem.linearise(descent.point)
        if not at.is_finite:
            break
        # A problem may weigh its residuals anew where it is linearised.
        descent.cost = at.cost
        groups = descent.trials()
        if not any(descent.accept(group, *_evaluated(problem, group)[::-1]) for group in groups):
            break
    return descent


def _evaluated(problem: Problem, points: Array) -> tuple[Array, Array]:
    """Return residuals, ``(m, r)``, and costs, ``(m,)``, inf where a residual is not finite."""
    residuals = problem.residuals(points)
    costs = np.einsum("ij,ij->i", residuals, residuals)
    costs[~np.isfinite(costs)] = np.inf
    return residuals, costs
