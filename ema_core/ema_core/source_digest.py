"""A digest of the sources that a result follows from, by which an older one is known."""

import hashlib
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numba
import numpy as np


def source_digest(names: Sequence[str]) -> str:
    """Return a digest of the sources of modules and packages, and of the libraries they use.

    Parameters
    ----------
    names
        Modules, and packages with all that is in them.

    Raises
    ------
    RuntimeError
        When one has no source.
    """
    digest = hashlib.sha256(f"{np.__version__} {numba.__version__}".encode())
    for name in names:
        spec = find_spec(name)
        if spec is None or spec.origin is None:
            raise RuntimeError(f"module {name} has no source")
        source = Path(spec.origin)
        is_package = spec.submodule_search_locations is not None
        for path in sorted(source.parent.rglob("*.py")) if is_package else [source]:
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
