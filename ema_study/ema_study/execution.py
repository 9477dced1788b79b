"""Jobs over an executor: processes, threads, or any other of ``concurrent.futures``."""

import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Final

from ema_monitor.cores import limit_threads
from ema_study.plan import Job
from ema_study.record import Record
from ema_study.run import run_job

EXECUTORS: Final = ("processes", "threads", "serial")
"""Executors on this machine: several runs at once, in processes or in threads, or one by one. Each
run has one thread, so that its time does not depend on the executor."""


@contextmanager
def local_executor(kind: str, workers: int) -> Iterator[Executor]:
    """Provide an executor on this machine; when the block is left early, its runs are given up.

    Parameters
    ----------
    kind
        One of ``EXECUTORS``.
    workers
        How many runs at once; "serial" has one.

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


def execute(jobs: Iterable[Job], executor: Executor) -> Iterator[Record]:
    """Run jobs and yield their records as they are done.

    Parameters
    ----------
    jobs
        What to run.
    executor
        Any executor; where it is in other processes, this package must be there, too. What has not
        begun is cancelled when this iterator is closed.
    """
    # An interrupt of the terminal goes to all processes. Those that are started here inherit the
    # mask, so that it ends the study in one place only.
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


def _never() -> bool:
    return False


_is_cancelled: Callable[[], bool] = _never


def _prepare(is_cancelled: Callable[[], bool]) -> None:
    global _is_cancelled
    _is_cancelled = is_cancelled
    limit_threads(1)


def _run(job: Job) -> Record:
    return run_job(job, _is_cancelled)
