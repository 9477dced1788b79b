"""Compilation options of all kernels, and the folder of their cache.

numba's file cache of a function goes stale when a function that it calls changes in another file.
The name of the cache folder therefore contains a digest of the kernel's module and of all modules
of ours that it imports, directly or not.
"""

import hashlib
import importlib.util
import logging
import os
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, cast

import numba
from numba import config

from ema_core.kernel_cache import KernelCache

_KERNEL_PACKAGES = ("ema_core", "ema_sim", "ema_monitor")
_IMPORT = re.compile(r"^(?:from|import) +([\w.]+)(?: +import +(\([^)]*\)|.*))?", re.MULTILINE)


@cache
def _source(module: str) -> str:
    """Return the source of a module that may contain kernels; empty of any other."""
    package, *path = module.split(".")
    if package not in _KERNEL_PACKAGES:
        return ""
    spec = importlib.util.find_spec(package)
    for location in (spec.submodule_search_locations or ()) if spec else ():
        file = Path(location, *path)
        for candidate in (file.with_suffix(".py"), file / "__init__.py"):
            if candidate.is_file():
                return candidate.read_text()
    return ""


def _imports(source: str) -> list[str]:
    """Return the modules that a source imports, and the names from them, which may be modules."""
    found: list[str] = []
    for module, names in _IMPORT.findall(source):
        found += [module, *(f"{module}.{name}" for name in re.findall(r"\w+", names))]
    return found


def _digest(module: str) -> str:
    """Return a digest of a module and of what it imports from packages with kernels."""
    waiting, sources = [module], dict[str, str]()
    while waiting:
        name = waiting.pop()
        if name not in sources and (source := _source(name)):
            sources[name] = source
            waiting += _imports(source)
    digest = hashlib.sha256(numba.__version__.encode())
    for name in sorted(sources):
        digest.update(sources[name].encode())
    return digest.hexdigest()[:16]


@cache
def _cache_folder(module: str) -> str:
    root = os.environ.get("NUMBA_CACHE_DIR") or (
        Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ema"
    )
    return str(Path(root) / f"kernels-{_digest(module)}")


def _cache_of(function: Callable[..., Any]) -> KernelCache:
    """Return the cache of a kernel; RuntimeError when it cannot be in the folder of its module."""
    found = KernelCache(function)
    if not Path(found.cache_path).is_relative_to(_cache_folder(function.__module__)):
        # Elsewhere it would go stale when a kernel changes that this one calls.
        raise RuntimeError(found.cache_path)
    return found


def kernel() -> Callable[[Callable[..., Any]], Any]:
    """Return the decorator that compiles a kernel.

    Kernels divide by zero according to IEEE 754, release the interpreter lock, never raise and are
    cached on disk where that is possible.
    """

    def compile_kernel(function: Callable[..., Any]) -> Any:
        folder = _cache_folder(function.__module__)
        # pyright does not see the options, which numba sets from the environment.
        shared_folder = config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
        config.CACHE_DIR = folder  # pyright: ignore[reportAttributeAccessIssue]
        compiled = numba.njit(error_model="numpy", nogil=True)(function)
        try:
            # numba has no other way to a cache of one's own.
            cast(Any, compiled)._cache = _cache_of(function)
        except RuntimeError:
            root = Path(folder).parent
            _log_once(f"{root} cannot be written: kernels are compiled at each start")
        finally:
            config.CACHE_DIR = shared_folder  # pyright: ignore[reportAttributeAccessIssue]

        return compiled

    return compile_kernel


@cache
def _log_once(text: str) -> None:
    logging.getLogger(__name__).warning(text)
