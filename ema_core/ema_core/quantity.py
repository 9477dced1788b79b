# SPDX-License-Identifier: Apache-2.0
"""Dataclass fields with metadata for validation, documentation and node parameters."""

import math
from dataclasses import Field, field, fields
from typing import Any, Final, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

_MISTAKEN_UNITS: Final = {
    "rad": (("degrees", math.radians(1.0)), ("mrad", 1e-3)),
    "rad/s": (("rpm", 2.0 * math.pi / 60.0),),
    "H": (("mH", 1e-3), ("uH", 1e-6)),
    "ohm": (("mohm", 1e-3),),
    "N.m": (("mN.m", 1e-3),),
    "N.m/A": (("mN.m/A", 1e-3),),
    "V.s/rad": (("mV.s/rad", 1e-3),),
    "kg.m^2": (("kg.cm^2", 1e-4), ("g.cm^2", 1e-7)),
}
"""Units that are often confused with each unit, with their size in that unit."""


def quantity(
    default: float,
    unit: str,
    lowest: float,
    highest: float,
    description: str,
    usual: tuple[float, float] | None = None,
    shown: tuple[str, str, float] | None = None,
    named: str = "",
) -> Any:
    """Return a dataclass field for a number with unit and range.

    Parameters
    ----------
    default
        Default value; the field is an integer if the default is an int.
    unit
        Unit; "-" for a dimensionless number.
    lowest, highest
        Range, ends included.
    description
        Description for messages and documentation.
    usual
        Usual range. The message for a value outside ``lowest`` to ``highest`` uses it to suggest
        the unit that was probably meant.
    shown
        Name, unit, and scale (parameter units per ``unit``) of the node parameter. Some tools parse
        numbers with an exponent as strings; a different unit avoids the exponent.
    named
        Name of the node parameter, if the name of the field is a symbol.
    """
    of_number = {"unit": unit, "range": (lowest, highest), "usual": usual, "shown": shown}
    return field(
        default=default, metadata={"description": description, "named": named, **of_number}
    )


def text(
    default: str, description: str, choices: tuple[str, ...] = (), *, compare: bool = True
) -> Any:
    """Return a dataclass field for a string, optionally restricted to ``choices``.

    With ``compare=False``, equality ignores the field.
    """
    metadata = {"choices": choices, "description": description}
    return field(default=default, compare=compare, metadata=metadata)


def flag(default: bool, description: str) -> Any:
    """Return a dataclass field for a boolean; ``description`` explains the meaning of true."""
    return field(default=default, metadata={"flag": True, "description": description})


def texts(description: str, default: tuple[str, ...] = ()) -> Any:
    """Return a dataclass field for a tuple of strings."""
    return field(default=default, metadata={"texts": True, "description": description})


class Checked:
    """Base class of frozen dataclasses: validates fields, and converts numbers to int or float.

    Only fields created by ``quantity``, ``text``, ``texts`` or ``flag`` are checked.

    Raises
    ------
    ValueError
        If a value is not a finite number within its range, or not one of the choices; the
        message states name, value, unit and range.
    """

    def __post_init__(self) -> None:
        for item in fields(cast(Any, self)):
            value = getattr(self, item.name)
            check_value(item.name, value, item)
            if "range" in item.metadata:
                # An int in a float field would compile a second version of a kernel.
                kind = int if isinstance(item.default, int) else float
                object.__setattr__(self, item.name, kind(value))


def check_value(name: str, value: Any, item: Field[Any]) -> None:
    """Raise ``ValueError`` if a value is invalid for a dataclass field created by this module.

    The message states ``name``, value, unit and range. Other fields are not checked.
    """
    if "range" in item.metadata:
        _check_number(name, value, isinstance(item.default, int), item.metadata)
    elif "choices" in item.metadata:
        _check_text(name, value, item.metadata["choices"])
    elif "flag" in item.metadata and not isinstance(value, bool):
        raise ValueError(f"{name} = {value!r}: expected true or false")
    elif "texts" in item.metadata and not (
        isinstance(value, tuple) and all(isinstance(item, str) for item in value)
    ):
        raise ValueError(f"{name} = {value!r}: expected a list of strings")


def hint_of_unit(value: float, unit: str, usual: tuple[float, float] | None) -> str:
    """Return a hint for a refused value: the usual range, and the unit that was probably meant.

    The hint is appended to an error message and begins with a semicolon; "" without a usual range.
    For a ratio, unit "-", the inverse is tried.
    """
    if usual is None:
        return ""
    lowest, highest = usual
    scale = "" if unit == "-" else f" {unit}"
    text = f"; usually {lowest:g} to {highest:g}{scale}"
    if unit == "-":
        meant = [(f"1/{value:g}", 1.0 / value)] if value else []
    else:
        meant = [
            (f"{value:g} {name}", value * factor) for name, factor in _MISTAKEN_UNITS.get(unit, ())
        ]
    for words, number in meant:
        if lowest <= abs(number) <= highest:
            return f"{text}: {number:.4g}{scale} = {words} was probably meant"
    return text


MOST_BYTES: Final = 1 << 28
"""Largest memory of an array whose length depends on settings [B]."""


def check_length(count: float, what: str, columns: int = 1) -> None:
    """Raise ``ValueError`` if ``columns`` columns of ``count`` samples exceed ``MOST_BYTES``.

    ``count`` may be fractional or infinite; ``what`` states its origin in the error message.
    """
    size = 8.0 * columns * count
    if not size <= MOST_BYTES:
        raise ValueError(
            f"{what}: {count:.4g} samples would take {size:.3g} B, expected at most {MOST_BYTES} B"
        )


def is_finite_number(value: Any) -> bool:
    """Return whether a value is a finite number; False for booleans."""
    try:
        return not isinstance(value, bool | np.bool_) and math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def finite_samples(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return samples as a new array, ``(n,)``, after validation.

    Raises
    ------
    ValueError
        If there are no samples, or they have another shape or are not finite; the message begins
        with ``name``.
    """
    samples = np.array(values, dtype=np.float64)
    if samples.ndim != 1 or not samples.size:
        raise ValueError(
            f"{name} must be a non-empty one-dimensional array, not of shape {samples.shape}"
        )
    bad = np.flatnonzero(~np.isfinite(samples))
    if bad.size:
        raise ValueError(f"{name} sample {bad[0]} is {samples[bad[0]]}, not a finite number")
    return samples


def _check_number(name: str, value: Any, whole: bool, metadata: Any) -> None:
    unit, description = metadata["unit"], metadata["description"]
    shown = "" if unit == "-" else f" {unit}"
    lowest, highest = metadata["range"]
    if not is_finite_number(value):
        raise ValueError(
            f"{name} = {value!r}: expected a finite number in [{lowest:g}, {highest:g}]{shown} "
            f"({description})"
        )
    if not lowest <= value <= highest:
        raise ValueError(
            f"{name} = {value:g}{shown} is outside [{lowest:g}, {highest:g}]{shown} ({description})"
            + hint_of_unit(value, unit, metadata["usual"])
        )
    if whole and value != int(value):
        raise ValueError(f"{name} = {value:g} is not a whole number ({description})")


def _check_text(name: str, value: Any, choices: tuple[str, ...]) -> None:
    if not isinstance(value, str):
        raise ValueError(f"{name} = {value!r}: expected a string")
    if choices and value not in choices:
        raise ValueError(f"{name} = {value!r} is unknown; known: {', '.join(choices)}")
