# SPDX-License-Identifier: Apache-2.0
"""Digest of the source code that a result depends on, to detect outdated results."""

import hashlib
import importlib.util
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numba
import numpy as np

_IMPORT = re.compile(r"^ *(?:from|import) +([\w.]+)(?: +import +(\([^)]*\)|.*))?", re.MULTILINE)


def source_digest(names: Iterable[str]) -> str:
    """Return a digest of the source code of modules and of the ``ema_*`` modules they import.

    Imports are followed recursively. The digest includes the versions of numpy and numba.
    """
    waiting, sources = list(names), dict[str, str]()
    while waiting:
        name = waiting.pop()
        if name not in sources and (source := _source(name)):
            sources[name] = source
            for module, imported in _IMPORT.findall(source):
                # A name imported from a package may be a module.
                waiting += [module, *(f"{module}.{part}" for part in re.findall(r"\w+", imported))]
    digest = hashlib.sha256(f"{np.__version__} {numba.__version__}".encode())
    for name in sorted(sources):
        digest.update(sources[name].encode())
    return digest.hexdigest()[:16]


@cache
def _source(module: str) -> str:
    """Return the source code of an ``ema_*`` module, or "" for other modules."""
    package, *path = module.split(".")
    if not package.startswith("ema_"):
        return ""
    spec = importlib.util.find_spec(package)
    for location in (spec.submodule_search_locations or ()) if spec else ():
        file = Path(location, *path)
        for candidate in (file.with_suffix(".py"), file / "__init__.py"):
            if candidate.is_file():
                return candidate.read_text(encoding="utf-8")
    return ""
