"""Public names of a package that are imported when they are first used (PEP 562)."""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def lazy_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a package that exports ``__all__`` of its ``api``.

    A node or a command imports single modules, and shall not import the whole library.
    """

    def get(name: str) -> Any:
        if name == "__all__":  # requested by `from package import *`
            return import_module(f"{package}.api").__all__
        # Tools that inspect a module request special names; this shall not import the library.
        if not name.startswith("_"):
            api = import_module(f"{package}.api")
            if name in api.__all__:
                return getattr(api, name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        return sorted(import_module(f"{package}.api").__all__)

    return get, names
