# SPDX-License-Identifier: Apache-2.0
"""Parallel execution of runs in local processes or threads, or on a Dask cluster."""

import timeit
from collections.abc import Callable, Iterable, Iterator
from statistics import median
from typing import Final

import pandas as pd

from ema_core.tasks import Workers
from ema_monitor.model.threads import available_cpus, limit_threads
from ema_study.plan import Job
from ema_study.run import RunResult, run_job

_ROUNDS: Final = 3
_GENERATIONS: Final = 20
_RUNS_PER_WORKER: Final = 2


def execute(jobs: Iterable[Job], workers: Workers) -> Iterator[RunResult]:
    """Yield the results of jobs in order of completion; each job runs in one thread.

    Raises
    ------
    WorkerLostError, ClusterLostError
        If a run kills every worker it is assigned to, or no worker is reachable.
    """
    try:
        for outcome in workers.run(_run, jobs):
            yield outcome.result()
    finally:
        limit_threads(None)


def time_executors(model: str, workers: int | None = None) -> pd.DataFrame:
    """Return the times of the same runs with three modes of execution.

    The modes are: serially on one core, serially with each generation on all cores, and in parallel
    processes. As in tables 9 and 10 of the thesis, the runs use differential evolution for the low
    friction fault. The result has one row per mode; ``seconds`` is the median of three rounds.
    ``workers`` is the number of processes, by default the number of available processors.
    """
    workers = workers or available_cpus()
    runs = _RUNS_PER_WORKER * workers
    warm, *jobs = (
        Job(model, 10, "de", "friction low", "low", run, "all_generations", 50, generations)
        for run, generations in enumerate([1] + runs * [_GENERATIONS])
    )
    with Workers("processes", workers) as pool, Workers("threads", 1) as alone:
        modes: dict[str, Callable[[], object]] = {
            "serial, one core": lambda: list(execute(jobs, alone)),
            "serial, each generation on all cores": lambda: [run_job(job) for job in jobs],
            "runs side by side in processes": lambda: list(execute(jobs, pool)),
        }
        # Start processes, load kernels and simulate the reference before the measurement.
        list(execute(4 * workers * [warm], pool))
        run_job(warm)
        seconds = [median(timeit.repeat(work, number=1, repeat=_ROUNDS)) for work in modes.values()]
    frame = pd.DataFrame(
        {
            "model": model,
            "algorithm": "de",
            "how": list(modes),
            "workers": [1, 1, workers],
            "runs": runs,
            "generations": _GENERATIONS,
            "seconds": seconds,
        }
    )
    frame["seconds_a_run"] = frame["seconds"] / runs
    frame["speedup"] = frame["seconds"].iloc[0] / frame["seconds"]
    return frame


def _run(job: Job) -> RunResult:
    limit_threads(1)
    return run_job(job)
