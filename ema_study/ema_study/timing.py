"""Serial and parallel execution side by side, as the thesis timed them in its tables 9 and 10."""

import time
from collections.abc import Callable
from typing import Final

import pandas as pd

from ema_monitor.cores import available_cpus, limit_threads
from ema_study.execution import execute, local_executor
from ema_study.plan import Job
from ema_study.run import run_job

ALGORITHM: Final = "de"
"""The thesis timed differential evolution on the small friction fault."""

_ROUNDS = 3
_GENERATIONS = 20
_RUNS_A_WORKER = 2


def time_executors(model: str, workers: int | None = None) -> pd.DataFrame:
    """Time the same runs in one thread, with threads in each generation, and in processes.

    Parameters
    ----------
    model
        Name of the monitor model.
    workers
        Number of processes; one per available processor by default.

    Returns
    -------
    pandas.DataFrame
        A row a way: ``model``, ``algorithm``, ``how``, ``workers``, ``runs``, ``generations``,
        ``seconds`` (median of three rounds, the ways alternating), ``seconds_a_run``, ``speedup``.
    """
    workers = workers or available_cpus()
    runs = _RUNS_A_WORKER * workers
    warm, *jobs = (
        Job(model, 10, ALGORITHM, "friction low", "low", run, "all_generations", 50, generations)
        for run, generations in enumerate([1] + runs * [_GENERATIONS])
    )
    with local_executor("processes", workers) as pool:
        ways: dict[str, Callable[[], object]] = {
            "serial, one core": lambda: _in_turn(jobs, 1),
            "serial, each generation on all cores": lambda: _in_turn(jobs, None),
            "runs side by side in processes": lambda: list(execute(jobs, pool)),
        }
        # Not timed: processes start, kernels are loaded, the reference is run.
        list(execute(4 * workers * [warm], pool))
        run_job(warm)
        seconds: dict[str, list[float]] = {how: [] for how in ways}
        for _ in range(_ROUNDS):
            for how, work in ways.items():
                started = time.perf_counter()
                work()
                seconds[how].append(time.perf_counter() - started)
    frame = pd.DataFrame(
        {
            "model": model,
            "algorithm": ALGORITHM,
            "how": list(ways),
            "workers": [1, 1, workers],
            "runs": runs,
            "generations": _GENERATIONS,
            "seconds": pd.DataFrame(seconds).median().to_numpy(),
        }
    )
    frame["seconds_a_run"] = frame["seconds"] / runs
    frame["speedup"] = frame["seconds"].iloc[0] / frame["seconds"]
    return frame


def _in_turn(jobs: list[Job], threads: int | None) -> None:
    limit_threads(threads)
    try:
        for job in jobs:
            run_job(job)
    finally:
        limit_threads(None)
