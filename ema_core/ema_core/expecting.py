"""Arguments of public functions, checked for their types."""

from typing import Any


def require_type(name: str, value: Any, expected: type | tuple[type, ...], hint: str = "") -> None:
    """Raise ``ValueError`` if an argument is not of an expected type.

    Parameters
    ----------
    name, value
        The argument.
    expected
        Its type, or a tuple of permitted types.
    hint
        How to get a value of that type; "" for none.
    """
    types = expected if isinstance(expected, tuple) else (expected,)
    if not isinstance(value, types):
        names = " or ".join(kind.__name__ for kind in types)
        more = f": {hint}" if hint else ""
        raise ValueError(f"{name} is of type {type(value).__name__}, expected {names}{more}")
