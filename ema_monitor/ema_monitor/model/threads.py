# SPDX-License-Identifier: Apache-2.0
"""Parallel execution of one call's work in a thread pool.

numba's ``prange`` is not used: without OpenMP, it aborts the process if two threads call it at the
same time; with GNU OpenMP, it does not survive a fork.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

_limit: int | None = None


def available_cpus() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0))


def limit_threads(count: int | None) -> None:
    """Set the largest number of threads per call in this process.

    Parameters
    ----------
    count
        The limit. Use 1 if processes or threads already run in parallel. None, which is the
        default, permits one thread per available processor.
    """
    global _limit
    _limit = count


@cache
def _pool(process: int, count: int) -> ThreadPoolExecutor:
    """Return the thread pool of a process; a forked process needs its own pool."""
    return ThreadPoolExecutor(count, thread_name_prefix="model")


def run_in_threads(work: Callable[[int], None], tasks: int) -> None:
    """Call ``work`` with each number below ``tasks``, in several threads.

    Parameters
    ----------
    work
        Function that releases the interpreter lock and takes 100 us or more per call. The order of
        the calls is arbitrary.
    tasks
        Number of calls. The calling thread executes some of them; a single call uses no other
        thread.
    """
    numbers = iter(range(tasks))

    def run_tasks() -> None:
        for number in numbers:
            work(number)

    most = _limit or available_cpus()
    futures = [_pool(os.getpid(), most - 1).submit(run_tasks) for _ in range(min(tasks, most) - 1)]
    run_tasks()
    for future in futures:
        if not future.cancel():
            future.result()
