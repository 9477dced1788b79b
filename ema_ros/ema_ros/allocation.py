"""How the process of a node takes memory from the system, so that it gives back what it lets go."""

import ctypes
from typing import Final

# Numbers of <malloc.h> of glibc.
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
_M_ARENA_MAX: Final = -8

_LARGE_BYTES: Final = 128 * 1024
_KEPT_BYTES: Final = 16 * 1024 * 1024


def allocate_compactly() -> None:
    """Let all threads share one heap, without large arrays; to be called before threads begin.

    By default glibc gives each thread a heap of its own, and lets arrays of up to 32 MB into it
    once one of that size was freed. What is small and stays between them keeps their space from
    being given back or used by other threads: a monitor of four actuators grew by 1.3 MB a minute
    in its first quarter of an hour. Where the system's library is another one, nothing is changed.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        for name, value in (
            (_M_ARENA_MAX, 1),
            (_M_MMAP_THRESHOLD, _LARGE_BYTES),
            (_M_TRIM_THRESHOLD, _KEPT_BYTES),
        ):
            mallopt(ctypes.c_int(name), ctypes.c_int(value))
