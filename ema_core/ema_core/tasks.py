# SPDX-License-Identifier: Apache-2.0
"""Common interface for running tasks on local processes, threads or a Dask cluster."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

EXECUTORS: Final = ("processes", "threads", "dask")
"""Kinds of workers."""

_MOST_DEATHS: Final = 3
_CONNECT_S: Final = 10.0
_LOOK_S: Final = 1.0
_MOST_SILENCES: Final = 30


class WorkerLostError(RuntimeError):
    """A task killed every worker that ran it."""


class ClusterLostError(RuntimeError):
    """The scheduler of a cluster is unreachable."""


@dataclass(frozen=True)
class Outcome:
    """Result of a task: the item, and the returned value or raised error.

    The error is ``WorkerLostError`` if the task killed its workers.
    """

    item: Any
    value: Any = None
    error: BaseException | None = None

    def result(self) -> Any:
        """Return the value, or raise the error."""
        if self.error is not None:
            raise self.error
        return self.value


class Workers(AbstractContextManager["Workers", None]):
    """Pool of workers that call a function for many items; a context manager.

    If the block raises an exception, pending tasks are dropped and processes end at once. If a
    worker process dies, its task is retried alone, up to three runs in total.

    Parameters
    ----------
    kind
        One of ``EXECUTORS``.
    number
        Number of workers on this machine; ignored with a scheduler, which has its own workers.
    scheduler
        Address of a Dask scheduler; empty for a local cluster.

    Raises
    ------
    ValueError
        If the kind is unknown, ``number`` is below 1, a scheduler is given but ``kind`` is not
        ``dask``, or the package ``distributed`` is not installed.
    ClusterLostError
        If the scheduler does not answer.
    """

    def __init__(self, kind: str, number: int, scheduler: str = "") -> None:
        if kind not in EXECUTORS:
            raise ValueError(f"executor {kind!r} is unknown; known: {', '.join(EXECUTORS)}")
        if number < 1:
            raise ValueError(f"workers = {number}: expected at least 1")
        if scheduler and kind != "dask":
            raise ValueError(f"--scheduler {scheduler} requires the executor dask, not {kind}")
        self._kind, self._number = kind, number
        self._client: Any = None
        self._alive: Any = None
        if kind == "dask":
            self._client = _dask_client(number, scheduler)
        self._executor = self._open()

    def run(
        self, function: Callable[[Any], Any], items: Iterable[Any]
    ) -> Generator[Outcome, None, None]:
        """Call a function with each item and yield the outcomes in order of completion.

        Items are consumed as workers become free. If the iterator is closed early, tasks that have
        not started are dropped.

        Raises
        ------
        ClusterLostError
            If the scheduler is unreachable.
        """
        waiting, suspects = iter(items), deque[tuple[Any, int]]()
        pending: dict[Future[Any], tuple[Any, int]] = {}
        most, silences = 2 * self._workers() + 2, 0
        try:
            while True:
                if not suspects:
                    for item in islice(waiting, max(0, most - len(pending))):
                        pending[self._submit(function, item)] = item, 0
                elif not pending:
                    item, deaths = suspects.popleft()
                    pending[self._submit(function, item)] = item, deaths
                if not pending:
                    return
                done = wait(pending, _LOOK_S, FIRST_COMPLETED).done
                if not done:
                    self._replace_workers()
                silences = 0 if done or self._is_reachable() else silences + 1
                if silences >= _MOST_SILENCES:
                    raise self._lost()
                for future in done:
                    item, deaths = pending.pop(future)
                    try:
                        error = future.exception()
                    except CancelledError as cancelled:
                        # The scheduler has ended; a new scheduler would not know the task.
                        raise self._lost() from cancelled
                    # KilledWorker is matched by name: `distributed` is an optional dependency.
                    is_death = isinstance(error, BrokenProcessPool)
                    if not is_death and type(error).__name__ != "KilledWorker":
                        yield Outcome(item, None if error else future.result(), error)
                    elif deaths + 1 < _MOST_DEATHS:
                        # A dead worker fails all tasks of the pool: repeat each task alone.
                        suspects.append((item, deaths + 1))
                    else:
                        text = f"{deaths + 1} worker processes ended while they worked on it"
                        yield Outcome(item, error=WorkerLostError(text))
        finally:
            for future in pending:
                future.cancel()

    def __exit__(self, kind: object, *_: object) -> None:
        is_failed = kind is not None
        # If the workers of a pool end, its remaining tasks fail: cancel them first.
        drop: Any = {"cancel_futures": is_failed} if self._client is None else {}
        with suppress(OSError, RuntimeError, TimeoutError):
            self._executor.shutdown(wait=not is_failed, **drop)
        if self._alive is not None:
            self._alive.close()
        if self._client is not None:
            with suppress(CancelledError, OSError, RuntimeError, TimeoutError):
                self._client.close(timeout=_CONNECT_S)
            if self._client.cluster is not None:
                self._client.cluster.close(timeout=_CONNECT_S)

    def _open(self) -> Executor:
        if self._client is not None:
            return self._client.get_executor(pure=False)
        if self._kind == "threads":
            return ThreadPoolExecutor(self._number, thread_name_prefix="task")
        # Forked children would inherit locks held by threads that do not exist in the child.
        context = multiprocessing.get_context("spawn")
        reader, self._alive = context.Pipe(duplex=False)
        return ProcessPoolExecutor(self._number, context, _begin_worker, (reader,))

    def _submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        try:
            future = self._executor.submit(function, item)
        except BrokenProcessPool:
            self._executor.shutdown(wait=False)
            self._executor = self._open()
            future = self._executor.submit(function, item)
        except (OSError, RuntimeError) as error:
            raise (self._lost() if self._client is not None else error) from error
        # If a pool is garbage-collected before its futures, it does not drop its waiting tasks.
        vars(future)["pool"] = self._executor
        return future

    def _workers(self) -> int:
        if self._client is None:
            return self._number
        return max(1, sum(self._client.nthreads().values())) if self._is_reachable() else 1

    def _replace_workers(self) -> None:
        """Start missing local workers of Dask.

        Dask restarts a killed worker, unless it is killed before its start is confirmed.
        """
        if self._client is not None and self._client.cluster is not None:
            self._client.cluster.scale(self._number)

    def _is_reachable(self) -> bool:
        return self._client is None or self._client.status == "running"

    def _lost(self) -> ClusterLostError:
        address = self._client.scheduler.address
        return ClusterLostError(
            f"the Dask scheduler {address} is unreachable; finished tasks are kept"
        )


def _dask_client(number: int, scheduler: str) -> Any:
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ValueError(
            "the executor dask needs the package distributed: pip install 'ema_core[dask]'"
        ) from error
    place: Any = scheduler or LocalCluster(
        n_workers=number, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
    )
    try:
        return Client(place, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterLostError(
            f"the Dask scheduler {scheduler} does not answer within {_CONNECT_S:g} s: {error}"
        ) from error


def _begin_worker(parent: Any) -> None:
    """Ignore terminal interrupts, and exit when the parent closes its end of the pipe.

    The pipe is the only way to notice that the parent was killed.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end_with_parent() -> None:
        with suppress(EOFError, OSError):
            parent.recv()
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
