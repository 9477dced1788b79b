# SPDX-License-Identifier: Apache-2.0
"""Conversion between fields of settings and parameters of nodes and commands."""

from contextlib import suppress
from dataclasses import Field, fields
from typing import Any


class SettingsParameter:
    """Parameter for a dataclass field that ``quantity``, ``text``, ``texts`` or ``flag`` created.

    Attributes
    ----------
    name, unit
        Name with its prefix, and unit of the parameter.
    scale
        Number of parameter units per field unit; None if the units are equal.
    """

    def __init__(self, item: Field[Any], prefix: str) -> None:
        self.field = item
        usual = item.name, item.metadata.get("unit", ""), None
        name, self.unit, self.scale = item.metadata.get("shown", usual) or usual
        self.name = prefix + name

    def to_node(self, value: Any) -> Any:
        """Convert a field value to a parameter value."""
        if "texts" in self.field.metadata:
            # An empty list has no type in a parameter file.
            return list(value) or [""]
        return value if self.scale is None else float(f"{value * self.scale:.12g}")

    def from_node(self, value: Any) -> Any:
        """Convert a parameter value to a field value."""
        if "texts" in self.field.metadata and isinstance(value, list | tuple):
            return tuple(item for item in value if item != "")
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return value / self.scale if self.scale is not None and is_number else value

    def number_of(self, value: Any) -> Any:
        """Return a number, or the number in a string, converted to the type of the field.

        Other values are returned unchanged. YAML 1.1 parses 1e-06 as a string and 4 as an integer.
        """
        if "range" in self.field.metadata and type(value) in (str, int):
            with suppress(ValueError):
                return type(self.field.default)(value)
        return value


def parameters_of(definition: Any, prefix: str = "") -> list[SettingsParameter]:
    """Return the parameters for the described fields of a dataclass or an instance of it."""
    return [
        SettingsParameter(item, prefix)
        for item in fields(definition)
        if "description" in item.metadata
    ]
