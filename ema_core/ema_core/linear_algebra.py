"""Arrays of a few megabytes: linear algebra on one thread, and memory that is used again.

What computes here divides its work among processors itself. Threads below numpy would wait in a
loop and take a processor from the next worker; their number may change the last bits of a result.
The C library returns each array to the system: a sixth of an estimate's time is for new pages.
"""

import os
from collections.abc import Mapping
from typing import Final

_THREADS: Final = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_KEPT: Final = {"MALLOC_MMAP_THRESHOLD_": str(1 << 25), "MALLOC_TRIM_THRESHOLD_": str(1 << 26)}
"""Size of arrays that do not come from the heap, and how much of it may lie free [bytes]."""


def array_environment(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return the additions to an environment for such arrays; its own entries take precedence.

    Before numpy is imported it has an effect on threads, in processes started later on both.
    """
    threads = {} if "OMP_NUM_THREADS" in environment else dict.fromkeys(_THREADS, "1")
    return {name: value for name, value in (threads | _KEPT).items() if name not in environment}
