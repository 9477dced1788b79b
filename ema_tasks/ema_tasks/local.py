"""Workers on this machine: threads, or processes, of which any may be killed."""

import faulthandler
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any

from ema_core.linear_algebra import one_thread
from ema_tasks.pool import MOST_DEATHS, Outcome, Pool, Task, WorkerLostError


def nothing() -> None:
    """Prepare nothing."""


class ThreadPool(Pool):
    """Threads of this process.

    Parameters
    ----------
    workers
        Their number.
    """

    def __init__(self, workers: int) -> None:
        super().__init__()
        self.workers = workers
        self.description = f"{workers} threads"
        self._executor = ThreadPoolExecutor(workers, thread_name_prefix="task")
        self._done: SimpleQueue[tuple[Task, Future[Any]]] = SimpleQueue()

    def _begin(self, task: Task) -> None:
        future = self._executor.submit(task.function, *task.arguments)
        future.add_done_callback(lambda future: self._done.put((task, future)))

    def _next(self) -> Outcome:
        task, future = self._done.get()
        error = future.exception()
        return Outcome(task.name, None if error else future.result(), error)

    def _close(self, *, is_failed: bool) -> None:
        self._executor.shutdown(cancel_futures=is_failed)


class ProcessPool(Pool):
    """Processes, each with an executor of its own: one that ends takes no more than its task along.

    Parameters
    ----------
    workers
        Their number.
    prepare, given
        Called with these arguments in each process before its first task.
    limit_s
        Time after which a task ends its process [s]; 0 for none.
    """

    def __init__(
        self,
        workers: int,
        prepare: Callable[..., None] = nothing,
        given: tuple[Any, ...] = (),
        limit_s: float = 0.0,
        context: Any = None,
    ) -> None:
        super().__init__()
        self.workers = workers
        self.description = f"{workers} processes"
        # Forked children would inherit locks of threads that they do not have.
        self._context = context or multiprocessing.get_context("spawn")
        self._prepare = (prepare, *given)
        self._limit_s = limit_s
        self._idle = [self._executor() for _ in range(workers)]
        self._busy: set[ProcessPoolExecutor] = set()
        self._waiting: deque[Task] = deque()
        self._done: SimpleQueue[tuple[ProcessPoolExecutor, Task, Future[Any]]] = SimpleQueue()

    def _executor(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            1, self._context, initializer=_begin_worker, initargs=self._prepare
        )

    def _begin(self, task: Task) -> None:
        self._waiting.append(task)
        self._fill()

    def _fill(self) -> None:
        while self._waiting and self._idle:
            executor, task = self._idle.pop(), self._waiting.popleft()
            try:
                with _deaf_to_interrupts(), _one_thread_each():
                    future = executor.submit(_call, self._limit_s, task.function, *task.arguments)
            except BrokenProcessPool:
                # It was killed while it had nothing to do.
                executor.shutdown(wait=False)
                self._idle.append(self._executor())
                self._waiting.appendleft(task)
                continue
            self._busy.add(executor)
            future.add_done_callback(
                lambda future, executor=executor, task=task: self._done.put(
                    (executor, task, future)
                )
            )

    def _next(self) -> Outcome:
        while True:
            executor, task, future = self._done.get()
            self._busy.discard(executor)
            error = future.exception()
            if not isinstance(error, BrokenProcessPool):
                self._idle.append(executor)
                self._fill()
                return Outcome(task.name, None if error else future.result(), error)
            executor.shutdown(wait=False)
            self._idle.append(self._executor())
            task.deaths += 1
            if task.deaths < MOST_DEATHS:
                self._waiting.append(task)
                self._fill()
                continue
            self._fill()
            limit = f" or took longer than {self._limit_s:g} s" if self._limit_s else ""
            lost = WorkerLostError(
                f"{task.deaths} worker processes ended while they worked on it: they were killed, "
                f"crashed{limit}"
            )
            return Outcome(task.name, None, lost)

    def _close(self, *, is_failed: bool) -> None:
        for executor in (*self._idle, *self._busy):
            executor.shutdown(cancel_futures=is_failed)


def _begin_worker(prepare: Callable[..., None], *given: Any) -> None:
    # An interrupt of the terminal reaches all processes: the parent handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    prepare(*given)


def _end_with(parent: Any) -> None:
    """End this process when its parent has ended, killed perhaps: nothing else tells it."""
    parent.join()
    os._exit(1)


def _call(limit_s: float, function: Callable[..., Any], *arguments: Any) -> Any:
    if limit_s:
        # From a thread of its own that needs no lock of the interpreter's.
        faulthandler.dump_traceback_later(limit_s, exit=True)
    try:
        return function(*arguments)
    finally:
        if limit_s:
            faulthandler.cancel_dump_traceback_later()


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let a process that is started keep to one thread: the others have the other processors."""
    added = one_thread()
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Block SIGINT while a process is started: it inherits the mask until it ignores the signal."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
