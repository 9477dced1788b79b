"""Linear algebra on one thread: what computes here divides its work among processors itself.

The libraries below numpy start a thread for each processor. For arrays as small as those of a
window these wait in a loop most of the time and take a processor from the next worker, and their
number may change the last bits of a result.
"""

import os
from collections.abc import Mapping
from typing import Final

_VARIABLES: Final = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_OF_ALL: Final = "OMP_NUM_THREADS"


def one_thread(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return what to add to an environment for one thread; what it says already holds.

    The libraries read it when they are loaded: it has an effect before numpy is imported, and in
    processes that are started later.
    """
    if _OF_ALL in environment:
        return {}
    return {name: "1" for name in _VARIABLES if name not in environment}
