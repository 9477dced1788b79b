"""The loop around an optimizer: evaluation, best so far, termination and progress."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema_monitor.optimizers.interface import Optimizer


@dataclass(frozen=True)
class Termination:
    """When to stop.

    Attributes
    ----------
    budget
        Largest number of evaluations; a generation that would pass it is not begun.
    target
        Stop at this cost or below.
    stall_generations
        Stop after so many generations in a row ...
    tolerance
        ... in which the best cost fell by less than this share of itself.

    Raises
    ------
    ValueError
        When a figure is impossible.
    """

    budget: int = 10_000
    target: float = 0.0
    stall_generations: int = 30
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        if self.budget < 1:
            raise ValueError(f"budget = {self.budget} evaluations: expected at least 1")
        if self.stall_generations < 1:
            raise ValueError(f"stall_generations = {self.stall_generations}: expected at least 1")
        if not self.tolerance >= 0.0:
            raise ValueError(f"tolerance = {self.tolerance}: expected at least 0")


@dataclass(frozen=True)
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
    point: NDArray[np.float64]
    cost: float


def minimise(
    residuals_of: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    optimizer: Optimizer,
    termination: Termination,
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

    Raises
    ------
    ValueError
        When the budget does not allow even the first generation.
    """
    best = Progress(0, 0, np.empty(0), np.inf)
    stalled = 0
    while not optimizer.converged:
        points = optimizer.ask()
        evaluations = best.evaluations + len(points)
        if evaluations > termination.budget:
            if best.generation == 0:
                raise ValueError(
                    f"budget = {termination.budget} evaluations: the first generation "
                    f"alone takes {len(points)}"
                )
            return
        residuals = residuals_of(points)
        costs = np.einsum("ij,ij->i", residuals, residuals)
        costs[~np.isfinite(costs)] = np.inf
        optimizer.tell(points, costs, residuals)

        leader = int(np.argmin(costs))
        improved = costs[leader] < best.cost or best.generation == 0
        gain = best.cost - costs[leader] if improved else 0.0
        stalled = 0 if gain > termination.tolerance * best.cost else stalled + 1
        best = Progress(
            best.generation + 1,
            evaluations,
            points[leader].copy() if improved else best.point,
            float(costs[leader]) if improved else best.cost,
        )
        yield best
        if best.cost <= termination.target or stalled >= termination.stall_generations:
            return
