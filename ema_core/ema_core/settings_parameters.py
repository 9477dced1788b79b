# SPDX-License-Identifier: Apache-2.0
"""Conversion between fields of settings and parameters of nodes and commands."""

from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import Field, fields
from typing import Any

from ema_core.quantity import check_value, is_finite_number


class SettingsParameter:
    """Node parameter of a dataclass field created by ``quantity``, ``text``, ``texts`` or ``flag``.

    Attributes
    ----------
    name, unit, description
        Name with its prefix, unit, and description, which includes the symbol if there is one.
    old_name
        Name of the field with the prefix. It equals ``name`` for most fields. Where it differs,
        because it is a symbol or the parameter has another unit, it is refused.
    scale
        Number of parameter units per field unit; None if the units are equal.
    """

    def __init__(self, item: Field[Any], prefix: str) -> None:
        self.field = item
        metadata, symbol = item.metadata, item.metadata.get("named")
        usual = symbol or item.name, metadata.get("unit", ""), None
        name, self.unit, self.scale = metadata.get("shown") or usual
        self.name, self.old_name = prefix + name, prefix + item.name
        self.description = metadata["description"] + (f", symbol {item.name}" if symbol else "")

    def to_node(self, value: Any) -> Any:
        """Return a field value converted to a parameter value."""
        if "texts" in self.field.metadata:
            # An empty list has no type in a parameter file.
            return list(value) or [""]
        return value if self.scale is None else float(f"{value * self.scale:.12g}")

    def from_node(self, value: Any) -> Any:
        """Return a parameter value converted to a field value.

        Raises
        ------
        ValueError
            If the value does not suit the field; the message names the parameter.
        """
        if "texts" in self.field.metadata and isinstance(value, list | tuple):
            value = tuple(item for item in value if item != "")
        if self.scale is not None and is_finite_number(value):
            return value / self.scale
        check_value(self.name, value, self.field)
        return value

    def number_of(self, value: Any) -> Any:
        """Return a number, or the number in a string, converted to the type of the field.

        Other values are returned unchanged. YAML 1.1 parses 1e-06 as a string and 4 as an integer.
        """
        if "range" in self.field.metadata and type(value) in (str, int):
            with suppress(ValueError):
                return type(self.field.default)(value)
        return value


def parameters_of(definition: Any, prefix: str = "") -> list[SettingsParameter]:
    """Return a parameter for each field with a description, of a dataclass or its instance."""
    return [
        SettingsParameter(item, prefix)
        for item in fields(definition)
        if "description" in item.metadata
    ]


def field_values(definition: Any, values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return values keyed by field name, from values keyed by prefixed parameter name.

    Names that are not parameters of the dataclass are ignored.

    Raises
    ------
    ValueError
        If a value is of another type or out of range; the message names the parameter.
    """
    return {
        item.field.name: item.from_node(item.number_of(values[item.name]))
        for item in parameters_of(definition, prefix)
        if item.name in values
    }


def refuse_old_names(parameters: Iterable[SettingsParameter], names: Collection[str]) -> None:
    """Raise ``ValueError`` if ``names`` contains an old name; the message states the valid name."""
    for item in parameters:
        if item.old_name != item.name and item.old_name in names:
            raise ValueError(f"parameter {item.old_name} is named {item.name}: use this name")
