"""The loop around an optimizer: evaluation, best so far, termination and progress."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from ema_core.arrays import Array
from ema_monitor.optimizers.interface import Optimizer


class StopRule(Protocol):
    """When to stop."""

    @property
    def budget(self) -> int:
        """Largest number of evaluations; a generation that would pass it is not begun."""
        ...

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return whether to stop, by the best cost so far after each generation, at least one."""
        ...


@dataclass(frozen=True)
class Termination:
    """The stop rule by stall; nothing costs less than 0, either.

    Attributes
    ----------
    budget
        As of `StopRule`.
    stall_generations
        Stop after so many generations in a row ...
    tolerance
        ... in which the best cost fell by less than this share of itself.
    """

    budget: int = 10_000
    stall_generations: int = 30
    tolerance: float = 1e-6

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return whether to stop, see :meth:`StopRule.reached`."""
        if best_costs[-1] <= 0.0:
            return True
        if len(best_costs) <= self.stall_generations:
            return False
        recent = best_costs[-self.stall_generations - 1 :]
        return not any(self._fell(before, after) for before, after in pairwise(recent))

    def _fell(self, before: float, after: float) -> bool:
        # From no cost at all to the first finite one is a fall, too.
        return after < before and not before - after <= self.tolerance * min(before, 1e300)


@dataclass(frozen=True, eq=False)
class Progress:
    """Where a run stands after a generation.

    Attributes
    ----------
    generation, evaluations
        How many are done.
    point
        Best point so far, ``(d,)``.
    cost
        Its cost; inf as long as no point had one.
    """

    generation: int
    evaluations: int
    point: Array
    cost: float


def minimise(
    residuals_of: Callable[[Array], Array],
    optimizer: Optimizer,
    termination: StopRule,
    *,
    reserve: int = 0,
) -> Iterator[Progress]:
    """Run an optimizer and yield its progress after every generation; to cancel, stop asking.

    Parameters
    ----------
    residuals_of
        Maps points, ``(m, d)``, to residuals, ``(m, n)``; the cost is their sum of squares. A
        point whose residuals are not finite costs inf.
    optimizer
        Where the points come from.
    termination
        When to stop.
    reserve
        Evaluations of the budget to reserve for later stages.

    Raises
    ------
    ValueError
        When the budget does not allow even the first generation.
    """
    best = Progress(0, 0, np.empty(0), np.inf)
    history: list[float] = []
    while not optimizer.converged:
        points = optimizer.ask()
        evaluations = best.evaluations + len(points)
        if evaluations + reserve > termination.budget:
            if best.generation == 0:
                raise ValueError(
                    f"budget = {termination.budget} evaluations: at least "
                    f"{len(points) + reserve} are needed"
                )
            return
        residuals = residuals_of(points)
        costs = np.einsum("ij,ij->i", residuals, residuals)
        costs[~np.isfinite(costs)] = np.inf
        optimizer.tell(points, costs, residuals)

        leader = int(np.argmin(costs))
        improved = best.generation == 0 or costs[leader] < best.cost
        best = Progress(
            best.generation + 1,
            evaluations,
            points[leader].copy() if improved else best.point,
            float(costs[leader]) if improved else best.cost,
        )
        history.append(best.cost)
        yield best
        if termination.reached(history):
            return
