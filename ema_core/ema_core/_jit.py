"""Compilation options of all kernels, and the folder of their cache.

numba's file cache of a function goes stale when a function that it calls changes in another file.
The name of the cache folder therefore contains a digest of all sources that may contain kernels.
"""

import hashlib
import importlib.util
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import config

_KERNEL_PACKAGES = ("ema_core", "ema_sim", "ema_monitor")


@cache
def _cache_folder() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for package in _KERNEL_PACKAGES:
        spec = importlib.util.find_spec(package)
        for location in (spec.submodule_search_locations or ()) if spec else ():
            for source in sorted(Path(location).rglob("*.py")):
                digest.update(source.read_bytes())
    root = os.environ.get("NUMBA_CACHE_DIR") or (
        Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ema"
    )
    return str(Path(root) / f"kernels-{digest.hexdigest()[:16]}")


def kernel() -> Callable[[Callable[..., Any]], Any]:
    """Return the decorator that compiles a kernel.

    Kernels divide by zero according to IEEE 754, release the interpreter lock, never raise and are
    cached on disk.
    """

    def compile_kernel(function: Callable[..., Any]) -> Any:
        # pyright does not see the options, which numba sets from the environment.
        shared_folder = config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
        config.CACHE_DIR = _cache_folder()  # pyright: ignore[reportAttributeAccessIssue]
        try:
            return numba.njit(error_model="numpy", nogil=True, cache=True)(function)
        finally:
            config.CACHE_DIR = shared_folder  # pyright: ignore[reportAttributeAccessIssue]

    return compile_kernel
