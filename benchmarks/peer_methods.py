"""Our identification and the optimizers of others, each run on one window and recorded.

Needs the virtual environment that tools/peers.sh makes.
"""

import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import cma  # pyright: ignore[reportMissingImports] - only in .venv-peers
import numpy as np
from numpy.typing import NDArray
from pymoo.algorithms.soo.nonconvex.de import DE  # pyright: ignore[reportMissingImports]
from pymoo.algorithms.soo.nonconvex.ga import GA  # pyright: ignore[reportMissingImports]
from pymoo.algorithms.soo.nonconvex.pso import PSO  # pyright: ignore[reportMissingImports]
from pymoo.core.problem import Problem  # pyright: ignore[reportMissingImports]
from pymoo.core.termination import NoTermination  # pyright: ignore[reportMissingImports]
from pymoo.optimize import minimize  # pyright: ignore[reportMissingImports]
from scipy.optimize import (  # pyright: ignore[reportMissingImports]
    differential_evolution,
    least_squares,
)
from trials import ACTUATOR

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import Identification
from ema_monitor.identification.objective import Objective
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.optimizers.least_squares import DIFFERENCE
from ema_monitor.windows.window import Window

STARTS: Final = 8
"""Number of random starts of the multi-start."""


@dataclass(frozen=True, eq=False)
class Task:
    """What a method is given."""

    window: Window
    calibration: Calibration
    seed: int
    budget: int


class BudgetSpentError(Exception):
    """The next batch would pass the budget."""


class Moment(NamedTuple):
    """Evaluations and time [s] so far, and the best fault vector by then."""

    evaluations: int
    seconds: float
    faults: NDArray[np.float64]


class Recorder:
    """The objective, which counts and keeps the best point by cost after every batch."""

    def __init__(self, task: Task) -> None:
        self._started = time.perf_counter()
        self._objective = Objective(task.window, task.calibration)
        self.healthy = self._objective.healthy
        self._budget = task.budget
        self._evaluations = 0
        self._best_cost, self._best_point = math.inf, self.healthy
        self._records: list[tuple[int, float, NDArray[np.float64]]] = []

    def residuals(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Residuals at points, ``(m, d)``, as a batch."""
        if self._evaluations + len(points) > self._budget:
            raise BudgetSpentError
        residuals = self._objective.residuals(points)
        costs = sums_of_squares(residuals)
        best = int(np.argmin(costs))
        if costs[best] < self._best_cost:
            self._best_cost, self._best_point = costs[best], points[best].copy()
        self._evaluations += len(points)
        elapsed = time.perf_counter() - self._started
        self._records.append((self._evaluations, elapsed, self._best_point))
        return residuals

    def costs(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Cost at points, ``(m, d)``, as a batch."""
        return sums_of_squares(self.residuals(points))

    def trace(self) -> list[Moment]:
        """Decode the best points after every batch."""
        evaluations, seconds, points = zip(*self._records, strict=True)
        faults, _ = self._objective.decode(np.array(points))
        return list(map(Moment, evaluations, seconds, faults))


def sums_of_squares(residuals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cost of each row; inf where it is not finite."""
    costs = np.einsum("ij,ij->i", residuals, residuals)
    return np.where(np.isfinite(costs), costs, np.inf)


Method = Callable[[Task], list[Moment]]
Search = Callable[[Recorder, int], object]


def ours(algorithm: str, *, parsimonious: bool = True) -> Method:
    """Identification as shipped: all that ``identify`` does, its last word included."""

    def run(task: Task) -> list[Moment]:
        settings = SearchSettings(
            algorithm, budget=task.budget, seed=task.seed, parsimonious=parsimonious
        )
        started = time.perf_counter()
        identification = Identification(task.window, ACTUATOR, task.calibration, settings)
        trace = [
            Moment(progress.evaluations, time.perf_counter() - started, progress.faults)
            for progress in identification
        ]
        elapsed = time.perf_counter() - started
        estimate = identification.estimate
        if estimate is None or not np.all(np.isfinite(estimate.faults)):
            raise RuntimeError(f"no estimate by {algorithm}: {estimate and estimate.reason}")
        return [*trace, Moment(estimate.evaluations, elapsed, np.array(estimate.faults))]

    return run


def peer(search: Search) -> Method:
    """Run another's method until it stops by itself or the budget is spent."""

    def run(task: Task) -> list[Moment]:
        recorder = Recorder(task)
        with contextlib.suppress(BudgetSpentError):
            search(recorder, task.seed)
        return recorder.trace()

    return run


def trust_region(
    recorder: Recorder, start: NDArray[np.float64], *, by_itself: bool = False
) -> None:
    """Run scipy's least squares, with its own difference quotients or with our step in a batch."""
    latest = np.empty(0)

    def residuals(point: NDArray[np.float64]) -> NDArray[np.float64]:
        nonlocal latest
        [latest] = recorder.residuals(point[None])
        return latest

    def jacobian(point: NDArray[np.float64]) -> NDArray[np.float64]:
        # It is asked for only where the residuals have just been.
        steps = np.where(point > 0.5, -DIFFERENCE, DIFFERENCE)
        return (recorder.residuals(point + np.diag(steps)) - latest).T / steps

    jac: Any = "2-point" if by_itself else jacobian  # the stubs know of names only
    least_squares(residuals, start, jac=jac, bounds=(0.0, 1.0), method="trf")


def from_healthy(recorder: Recorder, seed: int) -> None:
    """Run scipy's least squares from the healthy point, with difference quotients like ours."""
    trust_region(recorder, recorder.healthy)


def from_healthy_2_point(recorder: Recorder, seed: int) -> None:
    """Run the same with scipy's own difference quotients, one point at a time."""
    trust_region(recorder, recorder.healthy, by_itself=True)


def multi_start(recorder: Recorder, seed: int) -> None:
    """Run scipy's least squares from random starts, one after the other."""
    for start in np.random.default_rng(seed).random((STARTS, len(recorder.healthy))):
        trust_region(recorder, start)


def scipy_evolution(recorder: Recorder, seed: int) -> object:
    """Run scipy's differential evolution, vectorised."""
    return differential_evolution(
        lambda columns: recorder.costs(np.atleast_2d(columns.T)),
        [(0.0, 1.0)] * len(recorder.healthy),
        x0=recorder.healthy,
        vectorized=True,
        updating="deferred",
        rng=np.random.default_rng(seed),
    )


def covariance_adaptation(recorder: Recorder, seed: int) -> object:
    """Run CMA-ES with restarts of growing populations."""
    return cma.fmin2(
        None,
        recorder.healthy,
        0.3,
        {"bounds": [0.0, 1.0], "seed": seed + 1, "verbose": -9},
        restarts=9,
        incpopsize=2,
        parallel_objective=lambda points: recorder.costs(np.array(points)).tolist(),
    )


class BoxProblem(Problem):
    """The objective as pymoo wants it."""

    def __init__(self, recorder: Recorder) -> None:
        super().__init__(n_var=len(recorder.healthy), n_obj=1, xl=0.0, xu=1.0)
        self._recorder = recorder

    def _evaluate(self, x: NDArray[np.float64], out: dict[str, Any], *_: Any, **__: Any) -> None:
        out["F"] = self._recorder.costs(x)[:, None]


def pymoo(algorithm: type, population: int) -> Search:
    """Run an algorithm of pymoo, its population of the size that it has by default."""

    def search(recorder: Recorder, seed: int) -> object:
        first = np.random.default_rng(seed).random((population, len(recorder.healthy)))
        first[0] = recorder.healthy
        return minimize(
            BoxProblem(recorder),
            algorithm(pop_size=population, sampling=first),
            NoTermination(),
            seed=seed,
        )

    return search


METHODS: Final[dict[str, Method]] = {
    "ours": ours("least_squares"),
    "ours, not parsimonious": ours("least_squares", parsimonious=False),
    "ours, pso": ours("pso"),
    "scipy least_squares": peer(from_healthy),
    "scipy least_squares, 2-point": peer(from_healthy_2_point),
    f"scipy least_squares, {STARTS} starts": peer(multi_start),
    "scipy DE": peer(scipy_evolution),
    "cma with IPOP restarts": peer(covariance_adaptation),
    "pymoo PSO": peer(pymoo(PSO, 25)),
    "pymoo DE": peer(pymoo(DE, 100)),
    "pymoo GA": peer(pymoo(GA, 100)),
}
