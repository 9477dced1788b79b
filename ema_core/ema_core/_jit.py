"""Compilation options of all kernels, and the folder of their cache.

numba's file cache of a function goes stale when a function that it calls changes in another file.
The name of the cache folder therefore contains a digest of all sources that may contain kernels.
"""

import hashlib
import importlib.util
import logging
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, cast

import numba
from numba import config

from ema_core.kernel_cache import KernelCache

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


def _cache_of(function: Callable[..., Any]) -> KernelCache:
    """Return the cache of a kernel; RuntimeError when it cannot be in the folder of all kernels."""
    found = KernelCache(function)
    if not Path(found.cache_path).is_relative_to(_cache_folder()):
        # Elsewhere it would go stale when a kernel changes that this one calls.
        raise RuntimeError(found.cache_path)
    return found


def kernel() -> Callable[[Callable[..., Any]], Any]:
    """Return the decorator that compiles a kernel.

    Kernels divide by zero according to IEEE 754, release the interpreter lock, never raise and are
    cached on disk where that is possible.
    """

    def compile_kernel(function: Callable[..., Any]) -> Any:
        # pyright does not see the options, which numba sets from the environment.
        shared_folder = config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
        config.CACHE_DIR = _cache_folder()  # pyright: ignore[reportAttributeAccessIssue]
        compiled = numba.njit(error_model="numpy", nogil=True)(function)
        try:
            # numba has no other way to a cache of one's own.
            cast(Any, compiled)._cache = _cache_of(function)
        except RuntimeError:
            _log_once(f"{_cache_folder()} cannot be written: kernels are compiled at each start")
        finally:
            config.CACHE_DIR = shared_folder  # pyright: ignore[reportAttributeAccessIssue]

        return compiled

    return compile_kernel


@cache
def _log_once(text: str) -> None:
    logging.getLogger(__name__).warning(text)
