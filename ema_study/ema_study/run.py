# SPDX-License-Identifier: Apache-2.0
"""Computation of a single run, its result, and conversion of results to a table."""

import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from ema_core.faults import N_FAULTS, estimation_error
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import minimise
from ema_monitor.optimizers.interface import Hints
from ema_study.cases import CASES
from ema_study.models import problem
from ema_study.plan import Job
from ema_study.stop_rules import stop_rule, uncounted_populations

K: Final = [f"k{i}" for i in range(1, N_FAULTS + 1)]
"""Columns of the estimate; the columns of the truth have the prefix ``true_``."""


@dataclass(frozen=True)
class RunResult:
    """A run and its result."""

    job: Job
    estimate: list[float]
    """Estimated fault vector, of length 8."""
    error_percent: float
    """Estimation error (M14) in percent of the range."""
    cost: float
    cost_at_truth: float
    """Costs of the estimate and of the true fault vector [A^2.s]."""
    threshold: float | None
    """Cost at which the stop rule may stop [A^2.s]; None if the rule has no threshold."""
    generations: int
    """Number of generations. As in the thesis, only GWO counts the starting population."""
    evaluations: int
    time_s: float
    """Time on one core [s]."""
    costs: list[float]
    errors_percent: list[float]
    """Cost [A^2.s] and error [%] of the best point, for the starting population and after each
    generation."""


def as_frame(results: Iterable[RunResult]) -> pd.DataFrame:
    """Return a table with one row per run.

    The columns of the job come first, with its case as ``fault``. The truth is in ``true_k1`` to
    ``true_k8``, the estimate in ``k1`` to ``k8``.
    """
    rows = []
    for result in results:
        row = asdict(result)
        job, estimate = row.pop("job"), row.pop("estimate")
        case = CASES[job["case"]]
        job |= {"case": case.fault, "seed": result.job.seed}
        row["threshold"] = np.nan if result.threshold is None else result.threshold
        truth = zip([f"true_{k}" for k in K], case.truth.tolist(), strict=True)
        rows.append(job | row | dict(truth) | dict(zip(K, estimate, strict=True)))
    return pd.DataFrame(rows).rename(columns={"case": "fault"})


def run_job(job: Job) -> RunResult:
    """Compute a run and return its result.

    As in the thesis, the whole starting population is random.
    """
    objective, truth, floor, _ = problem(job.model, job.case)
    rng = np.random.default_rng(job.seed)
    settings: dict[str, Any] = {"population": job.population, **job.settings}
    start, hints = rng.random(objective.dimension), Hints(budget=job.budget)
    optimizer = ALGORITHMS[job.algorithm](start, rng, hints, **settings)
    stop = stop_rule(job.rule, job.algorithm, job.level, job.budget, floor)
    uncounted = uncounted_populations(job.algorithm)
    costs, errors = [], []
    faults, evaluations = truth, 0
    started = time.perf_counter()
    for progress in minimise(objective.residuals, optimizer, stop):
        [faults], _ = objective.decode(progress.point[None])
        evaluations = progress.evaluations
        costs.append(float(f"{progress.cost:.6g}"))
        errors.append(round(estimation_error(faults, truth), 4))
        # GA does not evaluate its elite again: its budget alone would allow more generations.
        if progress.generation - uncounted == job.max_generations:
            break
    time_s = time.perf_counter() - started
    return RunResult(
        job=job,
        estimate=faults.tolist(),
        error_percent=errors[-1],
        cost=costs[-1],
        cost_at_truth=floor,
        threshold=getattr(stop, "threshold", None),
        generations=len(costs) - uncounted,
        evaluations=evaluations,
        time_s=time_s,
        costs=costs,
        errors_percent=errors,
    )
