"""Mappings in YAML files."""

from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, Final

import yaml

from ema_bags.inputs.mapping import (
    AngleSource,
    Clock,
    CurrentSource,
    Mapping,
    SpeedSource,
    Table,
)
from ema_core.wording import unknown_name
from ema_core.yaml_file import load_yaml

SECTIONS: Final = {
    "position": AngleSource,
    "command": AngleSource,
    "error": AngleSource,
    "speed": SpeedSource,
    "current": CurrentSource,
    "clock": Clock,
    "table": Table,
}
"""Class of each section of a mapping file."""


def load_mapping(path: Path) -> Mapping:
    """Read a mapping.

    Raises
    ------
    ValueError
        When the file cannot be read or is no mapping; the message names the file.
    """
    try:
        content = load_yaml(path.expanduser())
    except OSError as error:
        raise ValueError(f"mapping file {path} cannot be read: {error.strerror}") from error
    try:
        return mapping_from(content)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def mapping_text(mapping: Mapping) -> str:
    """Return a mapping as the text of a file: what has its default is left out, units are not."""
    content: dict[str, Any] = {}
    for item in fields(Mapping):
        value = getattr(mapping, item.name)
        if item.name in SECTIONS:
            section = {} if value is None else _shown(value)
            if section:
                content[item.name] = section
        elif value:
            content[item.name] = list(value) if isinstance(value, tuple) else value
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def _shown(section: Any) -> dict[str, Any]:
    words = {}
    for item in fields(section):
        value = getattr(section, item.name)
        default = item.default if item.default is not MISSING else None
        told = item.name in ("unit", "shaft", "sampling", "kind") and hasattr(section, "topic")
        if value != default or told:
            words[item.name] = list(value) if isinstance(value, tuple) else value
    return words


def mapping_from(content: Any) -> Mapping:
    """Return the mapping of nested plain values, as a YAML file holds them.

    Raises
    ------
    ValueError
        When a name is unknown or a value impossible; the message begins with the section.
    """
    known = [item.name for item in fields(Mapping)]
    if not isinstance(content, dict):
        raise ValueError(f"expected a mapping with {', '.join(known)}, not {content!r}")
    given: dict[str, Any] = {}
    joint = content.get("joint", "")
    for name, section in content.items():
        if name not in known:
            raise ValueError(unknown_name("entry", name, known))
        if name in SECTIONS and section is not None:
            given[name] = _section(name, section)
        elif name not in SECTIONS:
            given[name] = section
    if not isinstance(joint, str):
        raise ValueError(f"joint = {joint!r}: expected the name of a joint")
    if not _is_texts(given.get("accept", ())):
        raise ValueError(f"accept = {given['accept']!r}: expected a list of names of defects")
    if "position" not in given:
        raise ValueError("position is missing: expected its source")
    return Mapping(**given)


def _section(name: str, section: Any) -> Any:
    kind = SECTIONS[name]
    known = [item.name for item in fields(kind)]
    if isinstance(section, str):
        section = {"source": section}
    if not isinstance(section, dict):
        raise ValueError(f"{name} = {section!r}: expected a mapping with {', '.join(known)}")
    values = {}
    for key, value in section.items():
        if key not in known:
            raise ValueError(f"{name}: {unknown_name('entry', key, known)}")
        values[key] = _number(value) if key in ("scale", "offset", "filter_time", "lead") else value
    if "phases" in values and not _is_texts(values["phases"]):
        raise ValueError(f"{name}: phases = {values['phases']!r}: expected a list of sources")
    try:
        return kind(**values)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def _is_texts(values: Any) -> bool:
    return isinstance(values, list | tuple) and all(isinstance(item, str) for item in values)


def _number(value: Any) -> Any:
    """Return a number that YAML 1.1 reads as text, such as 1e5, as a float."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
