"""Public names of a package that are imported when they are first used (PEP 562)."""

from collections.abc import Callable
from importlib import import_module
from typing import Any


def lazy_names(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return ``__getattr__`` and ``__dir__`` of a package that offers ``__all__`` of its ``api``.

    A node or a command imports modules one by one and must not pay for the whole library.
    """

    def get(name: str) -> Any:
        if name == "__all__":  # of `from package import *`
            return import_module(f"{package}.api").__all__
        # Inspecting a module requests Python's special names, which does not mean that it is used.
        if not name.startswith("_"):
            api = import_module(f"{package}.api")
            if name in api.__all__:
                return getattr(api, name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    def names() -> list[str]:
        return sorted(import_module(f"{package}.api").__all__)

    return get, names
