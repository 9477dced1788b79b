# SPDX-License-Identifier: Apache-2.0
"""Environment variables for work with medium-sized arrays: single-threaded algebra, reused memory.

The programs divide their work among processors themselves. Threads of numpy's linear algebra would
wait actively and occupy the processor of another worker, and their number may change the last bits
of a result. By default, the C library returns the memory of each array to the system; allocating
new pages would take a sixth of the time of an estimate.
"""

import os
from collections.abc import Mapping
from typing import Final

_THREADS: Final = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_MEMORY: Final = {"MALLOC_MMAP_THRESHOLD_": str(1 << 25), "MALLOC_TRIM_THRESHOLD_": str(1 << 26)}
"""Size above which arrays are allocated outside the heap, and largest unused part of the heap
[bytes]."""


def array_environment(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the variables to add to an environment, without overriding existing variables.

    In the current process, the limit on threads takes effect only if numpy is not yet imported. The
    memory settings take effect only in child processes.
    """
    threads = {} if "OMP_NUM_THREADS" in environment else dict.fromkeys(_THREADS, "1")
    return {name: value for name, value in (threads | _MEMORY).items() if name not in environment}
