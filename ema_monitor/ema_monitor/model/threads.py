"""Threads that share the work of one call.

numba's ``prange`` is not used: where OpenMP is missing it ends the process when two threads call
it at once, and with GNU OpenMP it does not survive a fork.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

_limit: int | None = None


def available_cpus() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0))


def limit_threads(count: int | None) -> None:
    """Set how many threads a call uses at most in this process.

    Parameters
    ----------
    count
        The limit, 1 where processes or threads already work side by side; None for one thread per
        available processor, as at the start.
    """
    global _limit
    _limit = count


@cache
def _pool(process: int, count: int) -> ThreadPoolExecutor:
    """Return threads of this process: a fork does not inherit its parent's threads."""
    return ThreadPoolExecutor(count, thread_name_prefix="model")


def run_in_threads(work: Callable[[int], None], tasks: int) -> None:
    """Call ``work`` with each number below ``tasks``, in several threads at once.

    Parameters
    ----------
    work
        A call lasts 100 us or more and releases the interpreter lock; the order is arbitrary.
    tasks
        Number of calls. The calling thread works too; a single call starts no other thread.
    """
    numbers = iter(range(tasks))

    def run_tasks() -> None:
        for number in numbers:
            work(number)

    most = _limit or available_cpus()
    others = [_pool(os.getpid(), most - 1).submit(run_tasks) for _ in range(min(tasks, most) - 1)]
    run_tasks()
    for other in others:
        if not other.cancel():
            other.result()
