"""Files of compiled kernels, each with a checksum of its content.

numba trusts the files of its cache: of a damaged one the loader of machine code aborts the process,
or the kernel raises whatever unpickling does.
"""

import hashlib
import logging
import pickle
from pathlib import Path
from typing import Any

from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.serialize import dumps

_DIGEST_BYTES = hashlib.sha256().digest_size
_log = logging.getLogger(__name__)


class _CheckedFiles(IndexDataCacheFile):
    """Index and data files of a kernel; a damaged one is removed, and counts as missing."""

    def _load_index(self) -> dict[Any, str]:
        content = self._read(Path(self._index_path))
        if content is None:
            return {}
        version, stamp, overloads = content
        is_fresh = (version, stamp) == (self._version, self._source_stamp)
        return overloads if is_fresh else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name: str) -> Any:
        content = self._read(Path(self._data_path(name)))
        if content is None:
            raise FileNotFoundError(name)  # numba compiles then
        return content

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, content: Any) -> None:
        text = dumps(content)
        with self._open_for_write(path) as file:
            file.write(hashlib.sha256(text).digest())
            file.write(text)

    def _read(self, path: Path) -> Any:
        """Return the content of a file; None when there is none, or it is damaged."""
        try:
            stored = path.read_bytes()
        except FileNotFoundError:
            return None
        digest, text = stored[:_DIGEST_BYTES], stored[_DIGEST_BYTES:]
        if hashlib.sha256(text).digest() != digest:
            _log.warning("%s is damaged: the kernel is compiled anew", path)
            path.unlink(missing_ok=True)
            return None
        return pickle.loads(text)


class KernelCache(FunctionCache):
    """Cache of one kernel; where nothing can be written the kernel is compiled for this process."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = _CheckedFiles(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=self._impl.locator.get_source_stamp(),
        )

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a compiled kernel."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _log.warning(
                "a compiled kernel cannot be stored in %s and is compiled at each start: %s",
                self.cache_path,
                error,
            )
