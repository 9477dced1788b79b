# SPDX-License-Identifier: Apache-2.0
"""Driver of an optimizer: evaluates points, tracks the best point, and ends the search."""

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
        """Return whether to stop, given the best cost after each generation so far."""
        ...


@dataclass(frozen=True)
class Termination:
    """Stop rule that ends a search if it stalls or reaches a cost of 0."""

    budget: int = 10_000
    """Largest number of evaluations; a generation that would exceed it is not started."""
    stall_generations: int = 30
    """Number of consecutive generations without improvement after which the search ends."""
    tolerance: float = 1e-6
    """Largest relative decrease of the best cost that does not count as an improvement [-]."""

    def reached(self, best_costs: Sequence[float]) -> bool:
        """Return whether to stop, given the best cost after each generation so far."""
        if best_costs[-1] <= 0.0:
            return True
        if len(best_costs) <= self.stall_generations:
            return False
        recent = best_costs[-self.stall_generations - 1 :]
        return not any(self._fell(before, after) for before, after in pairwise(recent))

    def _fell(self, before: float, after: float) -> bool:
        # A decrease from an infinite to a finite cost is an improvement.
        return after < before and not before - after <= self.tolerance * min(before, 1e300)


@dataclass(frozen=True, eq=False)
class SearchProgress:
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
) -> Iterator[SearchProgress]:
    """Yield the progress of a search after every generation.

    The search ends if the optimizer has converged, the stop rule is reached, or the next generation
    would exceed the budget. To cancel the search, stop iterating.

    Parameters
    ----------
    residuals_of
        Function that returns the residuals, ``(m, n)``, at points, ``(m, d)``. The cost is their
        sum of squares, or inf if a residual is not finite.
    optimizer
        Source of the points.
    termination
        Rule that ends the search.
    reserve
        Number of evaluations in the budget that are reserved for later stages.

    Raises
    ------
    ValueError
        If the budget is too small for the first generation.
    """
    best = SearchProgress(0, 0, np.empty(0), np.inf)
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
        best = SearchProgress(
            best.generation + 1,
            evaluations,
            points[leader].copy() if improved else best.point,
            float(costs[leader]) if improved else best.cost,
        )
        history.append(best.cost)
        yield best
        if termination.reached(history):
            return
