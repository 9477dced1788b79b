"""Public names of a package that are imported when they are first used.

A node or a command imports modules of a package one by one. It must not pay for the whole library
because the package itself has a public interface.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def lazy_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a package that offers ``__all__`` of its ``api``.

    Notes
    -----
    PEP 562. For type checkers the package imports everything from its ``api`` under
    ``TYPE_CHECKING``.
    """

    def get(name: str) -> Any:
        # Names of Python's own are asked for by whoever looks at a module; they mean no use of it.
        if not name.startswith("_"):
            api = import_module(f"{package}.api")
            if name in api.__all__:
                return getattr(api, name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        return sorted(import_module(f"{package}.api").__all__)

    return get, names
