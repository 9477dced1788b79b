"""Loop around an optimizer: evaluation, best point so far, termination and progress."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from ema_core.arrays import Array
from ema_monitor.optimizers.interface import Optimizer


class StopRule(Protocol):
    """Rule that ends a search."""

    @property
    def budget(self) -> int:
        """Largest number of evaluations; a generation that would exceed it is not started."""
        ...

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return whether to stop, from the best cost after each generation, at least one."""
        ...


@dataclass(frozen=True)
class Termination:
    """Stop rule for a stalled search; a cost of 0 ends the search as well."""

    budget: int = 10_000
    """Largest number of evaluations; a generation that would exceed it is not started."""
    stall_generations: int = 30
    """Number of consecutive generations with a small fall of the best cost that ends the search."""
    tolerance: float = 1e-6
    """Fall of the best cost that counts as small, relative to the cost [-]."""

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return whether to stop, from the best cost after each generation, at least one."""
        if best_costs[-1] <= 0.0:
            return True
        if len(best_costs) <= self.stall_generations:
            return False
        recent = best_costs[-self.stall_generations - 1 :]
        return not any(self._fell(before, after) for before, after in pairwise(recent))

    def _fell(self, before: float, after: float) -> bool:
        # A fall from an infinite to a finite cost counts.
        return after < before and not before - after <= self.tolerance * min(before, 1e300)


@dataclass(frozen=True, eq=False)
class Progress:
    """State of a search after a generation."""

    generation: int
    """Number of generations so far."""
    evaluations: int
    """Number of evaluations so far."""
    point: Array
    """Best point so far, ``(d,)``."""
    cost: float
    """Cost of the best point; inf if no point has a finite cost."""


def minimise(
    residuals_of: Callable[[Array], Array],
    optimizer: Optimizer,
    termination: StopRule,
    *,
    reserve: int = 0,
) -> Iterator[Progress]:
    """Run an optimizer and yield its progress after every generation.

    To cancel the search, stop iterating.

    Parameters
    ----------
    residuals_of
        Maps points, ``(m, d)``, to residuals, ``(m, n)``; the cost is their sum of squares. A point
        with residuals that are not finite costs inf.
    optimizer
        Source of the points.
    termination
        Rule that ends the search.
    reserve
        Evaluations of the budget to reserve for later stages.

    Raises
    ------
    ValueError
        If the budget does not permit the first generation.
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
