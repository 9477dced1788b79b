"""Runs on an executor: processes, threads, or any other of ``concurrent.futures``."""

import multiprocessing
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Final

import pandas as pd

from ema_monitor.model.threads import available_cpus, limit_threads
from ema_study.plan import Job
from ema_study.result import RunResult
from ema_study.run import run_job

EXECUTORS: Final = ("processes", "threads", "serial")
"""Executors on this machine: several runs at once, in processes or in threads, or one by one. Each
run has one thread, so that its time does not depend on the executor."""

_ROUNDS: Final = 3
_GENERATIONS: Final = 20
_RUNS_PER_WORKER: Final = 2


@contextmanager
def local_executor(kind: str, workers: int) -> Iterator[Executor]:
    """Provide an executor on this machine; an exception in the block cancels its runs.

    Parameters
    ----------
    kind
        One of ``EXECUTORS``.
    workers
        Number of runs at once; "serial" has one.

    Raises
    ------
    ValueError
        When the kind is unknown or there are no workers.
    """
    if kind not in EXECUTORS:
        raise ValueError(f"executor {kind!r} is unknown; known: {', '.join(EXECUTORS)}")
    if workers < 1:
        raise ValueError(f"workers = {workers}: expected at least 1")
    if kind == "processes":
        # Forked children would inherit locks of threads that they do not have.
        context = multiprocessing.get_context("spawn")
        cancelled = context.Event()
        executor: Executor = ProcessPoolExecutor(
            workers, context, initializer=_prepare, initargs=(cancelled.is_set,)
        )
    else:
        cancelled = threading.Event()
        executor = ThreadPoolExecutor(1 if kind == "serial" else workers)
        _prepare(cancelled.is_set)
    try:
        yield executor
    except BaseException:
        cancelled.set()
        raise
    finally:
        executor.shutdown(cancel_futures=True)
        if kind != "processes":
            limit_threads(None)


def execute(jobs: Iterable[Job], executor: Executor) -> Iterator[RunResult]:
    """Run jobs on any executor and yield their results as they end.

    Other processes must have this package, too. Runs that have not begun are cancelled when this
    iterator is closed.
    """
    # An interrupt of the terminal reaches all processes. Those started here inherit the mask, so
    # that only this process handles it.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        futures = [executor.submit(_run, job) for job in jobs]
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    try:
        for future in as_completed(futures):
            yield future.result()
    finally:
        for future in futures:
            future.cancel()


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
    with local_executor("processes", workers) as pool:
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
    return run_job(job, _is_cancelled)
