"""Work for all cores, in threads of its own.

numba's ``prange`` is not used: where OpenMP is missing it ends the process when two threads call
it at once, and with GNU OpenMP it does not survive a fork.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

from numba.core import config

_most: int | None = None


def limit_cores(count: int | None) -> None:
    """Use at most so many cores from now on in this process; None for as many as there are.

    Where processes or threads work side by side, each on one core, that is one.
    """
    global _most
    _most = count


@cache
def _helpers(process: int, count: int) -> ThreadPoolExecutor:
    """Return threads of this process: a fork does not inherit those of its parent."""
    return ThreadPoolExecutor(count, thread_name_prefix="cores")


def on_all_cores(work: Callable[[int], None], tasks: int) -> None:
    """Call ``work`` with each number below ``tasks``, on as many cores as there are or allowed.

    Parameters
    ----------
    work
        Takes some 100 us or more, releases the interpreter lock and does not mind the order.
    tasks
        How many calls. The calling thread works too, and makes a single call by itself.
    """
    numbers = iter(range(tasks))

    def take_turns() -> None:
        for number in numbers:
            work(number)

    # pyright does not see the option, which numba sets from processors and environment.
    cores = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
    if _most is not None:
        cores = min(cores, _most)
    helping = [
        _helpers(os.getpid(), cores - 1).submit(take_turns) for _ in range(min(tasks, cores) - 1)
    ]
    take_turns()
    for helper in helping:
        if not helper.cancel():
            helper.result()
