"""Fields of settings with metadata that validate, document and declare them."""

import math
from dataclasses import field, fields
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
"""By unit, those in which its values are given by mistake, each with its size in that unit."""


def quantity(
    default: float,
    unit: str,
    lowest: float,
    highest: float,
    description: str,
    usual: tuple[float, float] | None = None,
    shown: tuple[str, str, float] | None = None,
) -> Any:
    """Return a dataclass field of a number with its unit and range.

    Parameters
    ----------
    default
        Its default; a whole one makes it a field of whole numbers.
    unit
        Its unit, "-" where it has none.
    lowest, highest
        Its range, both included.
    description
        What it is.
    usual
        Its usual range, by which the message for a value outside the range suggests the unit that
        was probably meant.
    shown
        Name, unit, and how many of these are one ``unit``, as a parameter of a node: a figure that
        is written with an exponent in ``unit`` is read as a text by some tools.
    """
    of_number = {"unit": unit, "range": (lowest, highest), "usual": usual, "shown": shown}
    return field(default=default, metadata={"description": description, **of_number})


def text(
    default: str, description: str, choices: tuple[str, ...] = (), *, compare: bool = True
) -> Any:
    """Return a dataclass field of a text, one of the choices where there are some.

    A field that is not compared does not count for equality.
    """
    metadata = {"choices": choices, "description": description}
    return field(default=default, compare=compare, metadata=metadata)


def flag(default: bool, description: str) -> Any:
    """Return a dataclass field that is true or false; the description explains true."""
    return field(default=default, metadata={"flag": True, "description": description})


def texts(description: str, default: tuple[str, ...] = ()) -> Any:
    """Return a dataclass field of any number of texts."""
    return field(default=default, metadata={"texts": True, "description": description})


class Checked:
    """Base of frozen dataclasses: validates fields, and gives each number the type of its default.

    Fields that ``quantity``, ``text``, ``texts`` or ``flag`` has not made are not checked.

    Raises
    ------
    ValueError
        When a value is not a finite number within its range, or not one of the choices; the
        message names it, its value, unit and range.
    """

    def __post_init__(self) -> None:
        for item in fields(cast(Any, self)):
            value = getattr(self, item.name)
            if "range" in item.metadata:
                whole = isinstance(item.default, int)
                _check_number(item.name, value, whole, item.metadata)
                # A kernel compiles anew for an int in a float field: every value has its type here.
                object.__setattr__(self, item.name, int(value) if whole else float(value))
            elif "choices" in item.metadata:
                _check_text(item.name, value, item.metadata["choices"])
            elif "flag" in item.metadata and not isinstance(value, bool):
                raise ValueError(f"{item.name} = {value!r}: expected true or false")
            elif "texts" in item.metadata and not (
                isinstance(value, tuple) and all(isinstance(one, str) for one in value)
            ):
                raise ValueError(f"{item.name} = {value!r}: expected a list of texts")


def hint_of_unit(value: float, unit: str, usual: tuple[float, float] | None) -> str:
    """Return the usual range of a refused value, and the unit that was probably meant.

    It is the end of an error message, from its semicolon on; empty without a usual range. Of a
    ratio, "-", the inverse is tried.
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
"""Largest memory of an array whose length follows from external settings [B]."""


def check_length(count: float, what: str, columns: int = 1) -> None:
    """Raise ``ValueError`` unless ``columns`` of ``count`` samples fit into ``MOST_BYTES``.

    ``count`` is not rounded, and infinite where it overflows; ``what`` names its reason in errors.
    """
    size = 8.0 * columns * count
    if not size <= MOST_BYTES:
        raise ValueError(
            f"{what}: {count:.4g} samples would take {size:.3g} B, expected at most {MOST_BYTES} B"
        )


def is_finite_number(value: Any) -> bool:
    """Return whether a value is a finite number; True and False are not."""
    try:
        return not isinstance(value, bool | np.bool_) and math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def finite_samples(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Return a copy of a row of samples, ``(n,)``.

    Raises
    ------
    ValueError
        When it is empty, not a row or not finite; the message begins with ``name``.
    """
    samples = np.array(values, dtype=np.float64)
    if samples.ndim != 1 or not samples.size:
        raise ValueError(f"{name} must be a row of samples, not an array of {samples.shape}")
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
        raise ValueError(f"{name} = {value!r}: expected a text")
    if choices and value not in choices:
        raise ValueError(f"{name} = {value!r} is unknown; known: {', '.join(choices)}")
