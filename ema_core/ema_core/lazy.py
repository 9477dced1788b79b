# SPDX-License-Identifier: Apache-2.0
"""Lazy import of a package's public names on first use (PEP 562)."""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def lazy_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` that export ``__all__`` of ``package.api``.

    Nodes and commands import single modules and must not load the whole library.
    """

    def get(name: str) -> Any:
        if name == "__all__":  # requested by `from package import *`
            return import_module(f"{package}.api").__all__
        # Tools that inspect a module request special names; this must not import the library.
        if not name.startswith("_"):
            api = import_module(f"{package}.api")
            if name in api.__all__:
                return getattr(api, name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        return sorted(import_module(f"{package}.api").__all__)

    return get, names
