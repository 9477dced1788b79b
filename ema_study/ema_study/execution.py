"""Runs in a pool: processes or threads of this machine, or a Dask cluster."""

import multiprocessing
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Final

import pandas as pd

from ema_monitor.model.threads import available_cpus, limit_threads
from ema_study.plan import Job
from ema_study.result import RunResult
from ema_study.run import run_job
from ema_tasks.choice import open_pool
from ema_tasks.pool import Pool

EXECUTORS: Final = ("processes", "threads", "serial", "dask")
"""Several runs at once, in processes or threads of this machine, one by one, or on a Dask cluster.
Each run has one thread, so that its time does not depend on the executor."""

_ROUNDS: Final = 3
_GENERATIONS: Final = 20
_RUNS_PER_WORKER: Final = 2


@contextmanager
def study_pool(kind: str, workers: int, scheduler: str = "") -> Iterator[Pool]:
    """Provide a pool for runs; an exception in the block cancels those on this machine.

    Parameters
    ----------
    kind
        One of ``EXECUTORS``.
    workers
        Number of runs at once; "serial" has one.
    scheduler
        Address of a Dask scheduler; empty for a cluster of local processes.

    Raises
    ------
    ValueError
        When the kind is unknown or there are no workers.
    ClusterLostError
        When the scheduler does not answer.
    """
    if kind not in EXECUTORS:
        raise ValueError(f"executor {kind!r} is unknown; known: {', '.join(EXECUTORS)}")
    # Forked children would inherit locks of threads that they do not have.
    context = multiprocessing.get_context("spawn")
    cancelled = context.Event() if kind == "processes" else threading.Event()
    if kind == "processes":
        pool = open_pool(kind, workers, prepare=_prepare, given=(cancelled.is_set,))
    elif kind == "dask":
        pool = open_pool(kind, workers, scheduler)
    else:
        pool = open_pool("threads", 1 if kind == "serial" else workers)
        _prepare(cancelled.is_set)
    try:
        with pool:
            try:
                yield pool
            except BaseException:
                cancelled.set()
                raise
    finally:
        if kind in ("threads", "serial"):
            _prepare(_never)
            limit_threads(None)


def execute(jobs: Iterable[Job], pool: Pool) -> Iterator[RunResult]:
    """Run jobs in a pool and yield their results as they end.

    Raises
    ------
    WorkerLostError, ClusterLostError
        When a run ends each worker that it is given to, or the workers are out of reach.
    """
    return (outcome.result() for outcome in pool.run(_run, jobs))


def time_executors(model: str, workers: int | None = None) -> pd.DataFrame:
    """Time the same runs on one core, with each generation on all cores, and in processes.

    As the thesis in its tables 9 and 10: differential evolution on the small friction fault.

    Parameters
    ----------
    model
        Name of the monitor model.
    workers
        Number of processes; by default that of the cores.

    Returns
    -------
    pandas.DataFrame
        A row a mode: ``model``, ``algorithm``, ``how``, ``workers``, ``runs``, ``generations``,
        ``seconds`` (median of three rounds, the modes alternating), ``seconds_a_run``, ``speedup``.
    """
    workers = workers or available_cpus()
    runs = _RUNS_PER_WORKER * workers
    warm, *jobs = (
        Job(model, 10, "de", "friction low", "low", run, "all_generations", 50, generations)
        for run, generations in enumerate([1] + runs * [_GENERATIONS])
    )
    with study_pool("processes", workers) as pool:
        modes: dict[str, Callable[[], object]] = {
            "serial, one core": lambda: _in_turn(jobs, 1),
            "serial, each generation on all cores": lambda: _in_turn(jobs, None),
            "runs side by side in processes": lambda: list(execute(jobs, pool)),
        }
        # Not timed: processes start, kernels are loaded, the reference is run.
        list(execute(4 * workers * [warm], pool))
        run_job(warm)
        seconds: dict[str, list[float]] = {how: [] for how in modes}
        for _ in range(_ROUNDS):
            for how, work in modes.items():
                started = time.perf_counter()
                work()
                seconds[how].append(time.perf_counter() - started)
    frame = pd.DataFrame(
        {
            "model": model,
            "algorithm": "de",
            "how": list(modes),
            "workers": [1, 1, workers],
            "runs": runs,
            "generations": _GENERATIONS,
            "seconds": pd.DataFrame(seconds).median().to_numpy(),
        }
    )
    frame["seconds_a_run"] = frame["seconds"] / runs
    frame["speedup"] = frame["seconds"].iloc[0] / frame["seconds"]
    return frame


def _in_turn(jobs: list[Job], cores: int | None) -> None:
    limit_threads(cores)
    try:
        for job in jobs:
            run_job(job)
    finally:
        limit_threads(None)


def _never() -> bool:
    return False


_is_cancelled: Callable[[], bool] = _never


def _prepare(is_cancelled: Callable[[], bool]) -> None:
    global _is_cancelled
    _is_cancelled = is_cancelled
    limit_threads(1)


def _run(job: Job) -> RunResult:
    # A worker of a cluster was not prepared.
    limit_threads(1)
    return run_job(job, _is_cancelled)
