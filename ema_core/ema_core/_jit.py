# SPDX-License-Identifier: Apache-2.0
"""Compilation of kernels with numba, and their cache on disk.

numba's file cache of a function becomes stale if a called function changes in another file.
Therefore the name of the cache folder contains a digest of all ``ema_*`` modules that the module of
the kernel imports. A damaged cache file would abort the process; therefore each file has a
checksum.
"""

import hashlib
import logging
import os
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, cast

import numba
from numba import config
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.serialize import dumps

from ema_core.source_digest import source_digest

_DIGEST_BYTES = hashlib.sha256().digest_size
_log = logging.getLogger(__name__)


def kernel(*, nogil: bool = True) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function with numba.

    Kernels divide by zero according to IEEE 754, release the interpreter lock, never raise and are
    cached on disk if the cache folder is writable. Kernels that take only microseconds should keep
    the lock (``nogil=False``), because reacquiring it may take milliseconds.
    """

    def compile_kernel(function: Callable[..., Any]) -> Any:
        folder = _cache_folder(function.__module__)
        # numba defines this option at run time, from the environment: pyright does not see it.
        shared_folder = config.CACHE_DIR  # pyright: ignore[reportAttributeAccessIssue]
        config.CACHE_DIR = folder  # pyright: ignore[reportAttributeAccessIssue]
        compiled = numba.njit(error_model="numpy", nogil=nogil)(function)
        try:
            cache = _KernelCache(function)
            if not Path(cache.cache_path).is_relative_to(folder):
                # In another folder, the cache would become stale if a called kernel changes.
                raise RuntimeError(cache.cache_path)
            # numba has no public interface for a custom cache.
            cast(Any, compiled)._cache = cache
        except RuntimeError:
            root = Path(folder).parent
            _log_once(f"{root} is not writable: kernels are compiled at each start")
        finally:
            config.CACHE_DIR = shared_folder  # pyright: ignore[reportAttributeAccessIssue]
        return compiled

    return compile_kernel


@cache
def _cache_folder(module: str) -> str:
    root = os.environ.get("NUMBA_CACHE_DIR") or (
        Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ema"
    )
    return str(Path(root) / f"kernels-{source_digest([module])}")


@cache
def _log_once(text: str) -> None:
    _log.warning(text)


class _CheckedFiles(IndexDataCacheFile):
    """Index and data files of a kernel. Damaged files are removed and treated as missing."""

    def _load_index(self) -> dict[Any, str]:
        version, stamp, overloads = self._read(Path(self._index_path)) or (None, None, {})
        is_fresh = (version, stamp) == (self._version, self._source_stamp)
        return overloads if is_fresh else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name: str) -> Any:
        content = self._read(Path(self._data_path(name)))
        if content is None:
            raise FileNotFoundError(name)  # numba then compiles the kernel
        return content

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, content: Any) -> None:
        text = dumps(content)
        with self._open_for_write(path) as file:
            file.write(hashlib.sha256(text).digest() + text)

    def _read(self, path: Path) -> Any:
        """Return the content of a file; None if it is missing or damaged."""
        try:
            stored = path.read_bytes()
        except FileNotFoundError:
            return None
        digest, text = stored[:_DIGEST_BYTES], stored[_DIGEST_BYTES:]
        if hashlib.sha256(text).digest() != digest:
            _log.warning("%s is damaged: the kernel is recompiled", path)
            path.unlink(missing_ok=True)
            return None
        return pickle.loads(text)


class _KernelCache(FunctionCache):
    """Disk cache of a kernel. If it is not writable, the kernel is recompiled in each process."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = _CheckedFiles(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=self._impl.locator.get_source_stamp(),
        )

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a compiled kernel."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            text = "a compiled kernel cannot be stored in %s; it is compiled at each start: %s"
            _log.warning(text, self.cache_path, error)
