# SPDX-License-Identifier: Apache-2.0
"""Guided mapping: guessed from a file, overridden by options, completed by the user's answers."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import fields
from typing import Any, Final

import click
import yaml

from ema_bags.inputs.input_file import InputFile
from ema_bags.inputs.mapping import (
    AngleSource,
    Clock,
    ColumnMapping,
    CurrentSource,
    SpeedSource,
    TemperatureSource,
    mapping_text,
)
from ema_cli.parameters import value_of
from ema_core.description import ActuatorDescription
from ema_core.settings_file import settings_from
from ema_core.units import LINEAR

_SECTIONS: Final[dict[str, tuple[Any, tuple[str, ...], str]]] = {
    "position": (AngleSource, ("unit", "lead", "shaft"), ""),
    "command": (AngleSource, ("unit", "lead", "shaft"), "the position error is available"),
    "error": (AngleSource, ("unit", "lead", "shaft"), "the command is available"),
    "speed": (SpeedSource, ("unit", "lead", "shaft"), "not measured"),
    "current": (CurrentSource, ("kind", "unit", "sampling"), "not measured"),
    "temperature": (TemperatureSource, ("unit",), "not measured"),
    "clock": (Clock, ("unit",), "there is no time column, only a rate"),
}
"""Type of the source, entries to ask for, and meaning of an omitted source, keyed by quantity."""


def mapping_of(
    source: InputFile, description: ActuatorDescription, entries: Sequence[str], *, asks: bool
) -> ColumnMapping:
    """Return the mapping for a file: guessed, overridden by entries, completed by user input.

    Parameters
    ----------
    source
        The file.
    description
        Description of the actuator.
    entries
        Entries such as ``position.unit=mm``; the user is not asked for these.
    asks
        Whether to ask the user for all remaining entries.

    Raises
    ------
    ValueError
        If an entry is malformed, or the entries do not form a valid mapping.
    """
    is_set = {key: value for key, _, value in (item.partition("=") for item in entries)}
    content: dict[str, Any] = {}
    with suppress(ValueError):
        guess = source.guess(description, _clock(is_set))
        content = yaml.safe_load(mapping_text(guess.mapping))
    for key, value in is_set.items():
        section, _, entry = key.rpartition(".")
        target = content.setdefault(section, {}) if section else content
        target[entry] = value if entry == "source" else value_of(value)
        if not asks and target[entry] == "-":
            del content[section]
    while True:
        try:
            if asks:
                _ask(content, is_set)
            mapping = settings_from(ColumnMapping, content)
            source.series(mapping)
            return mapping
        except ValueError as error:
            if not asks:
                raise
            click.echo(f"{error}\nAnswer again; Enter keeps the previous answer.", err=True)
            is_set = {}


def _clock(is_set: dict[str, str]) -> Clock | None:
    """Return the clock in the entries, or None if neither its source nor its rate is set."""
    start = "clock."
    texts = {key[len(start) :]: text for key, text in is_set.items() if key.startswith(start)}
    if not {"source", "rate_hz"} & texts.keys():
        return None
    values = {name: text if name == "source" else value_of(text) for name, text in texts.items()}
    return settings_from(Clock, values)


def _ask(content: dict[str, Any], is_set: dict[str, str]) -> None:
    """Ask the user for each entry that no option sets, with the guess as default."""
    for name, (kind, entries, none) in _SECTIONS.items():
        section = content.get(name, {})
        if name == "error" and "command" in content:
            continue
        if f"{name}.source" not in is_set:
            words = f"{name}: column or sum of columns" + (f"; - if {none}" if none else "")
            section["source"] = click.prompt(words, section.get("source", "-" if none else None))
        if section["source"] == "-":
            content.pop(name, None)
            if name != "clock":
                continue
            section, entries = {}, ("rate_hz",)
        content[name] = section
        by_name = {item.name: item for item in fields(kind)}
        for entry in entries:
            item, key = by_name[entry], f"{name}.{entry}"
            if entry == "lead" and section.get("unit") not in LINEAR:
                section.pop("lead", None)
            elif key not in is_set:
                choices = item.metadata.get("choices")
                section[entry] = click.prompt(
                    f"{key}: {item.metadata['description']}",
                    section.get(entry, item.default or None),
                    type=click.Choice(choices) if choices else float,
                )
