"""Mappings in YAML files."""

from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import yaml

from ema_inputs.mapping import SECTIONS, Mapping, mapping_from


def load_mapping(path: Path) -> Mapping:
    """Read a mapping.

    Raises
    ------
    ValueError
        When the file cannot be read or is no mapping; the message names the file.
    """
    try:
        content = yaml.safe_load(path.expanduser().read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"mapping file {path} cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not a YAML file: {error}") from error
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
            section = {} if value is None else _section(value, mapping.joint)
            if section:
                content[item.name] = section
        elif value:
            content[item.name] = list(value) if isinstance(value, tuple) else value
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def _section(section: Any, joint: str) -> dict[str, Any]:
    words = {}
    for item in fields(section):
        value = getattr(section, item.name)
        default = item.default if item.default is not MISSING else None
        told = item.name in ("unit", "shaft", "sampling", "kind") and hasattr(section, "topic")
        if item.name == "joint" and value == joint:
            continue
        if value != default or told:
            words[item.name] = list(value) if isinstance(value, tuple) else value
    return words
