# SPDX-License-Identifier: Apache-2.0
"""Type checks of arguments of public functions."""

from collections.abc import Callable
from types import NoneType
from typing import Any, TypeVar

T = TypeVar("T")


def require_type(name: str, value: Any, expected: type | tuple[type, ...], hint: str = "") -> None:
    """Raise ``ValueError`` if an argument has the wrong type.

    Parameters
    ----------
    name, value
        Name and value of the argument.
    expected
        Permitted type, or a tuple of permitted types.
    hint
        Hint for the message, such as a function that returns this type; "" for none.
    """
    types = expected if isinstance(expected, tuple) else (expected,)
    if not isinstance(value, types):
        names = " or ".join("None" if kind is NoneType else kind.__name__ for kind in types)
        more = f": {hint}" if hint else ""
        raise ValueError(f"{name} is of type {type(value).__name__}, expected {names}{more}")


def value_or_default(
    name: str, value: T | None, expected: type | tuple[type, ...], default: Callable[[], T]
) -> T:
    """Return an argument, or its default for None; raise ``ValueError`` for a wrong type.

    Parameters
    ----------
    name, value
        Name and value of the argument.
    expected
        Permitted type, or a tuple of permitted types.
    default
        Function that returns the default.
    """
    if value is None:
        return default()
    require_type(name, value, expected)
    return value
