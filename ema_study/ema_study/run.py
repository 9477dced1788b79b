"""A single run of the study."""

import time
from typing import Any

import numpy as np

from ema_core.faults import estimation_error
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.optimizers.driver import minimise
from ema_monitor.optimizers.interface import Hints
from ema_study.models import problem
from ema_study.plan import Job
from ema_study.result import RunResult
from ema_study.stop_rules import stop_rule, uncounted_populations


def run_job(job: Job) -> RunResult:
    """Make a run; as in the thesis, the whole starting population is random."""
    objective, truth, floor = problem(job.model, job.case)
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
