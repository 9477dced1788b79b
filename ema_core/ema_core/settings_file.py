# SPDX-License-Identifier: Apache-2.0
"""Settings, descriptions and mappings from YAML files."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, cast, get_args, get_type_hints

from ema_core.wording import unknown_name
from ema_core.yaml_file import load_yaml

_Settings = TypeVar("_Settings")
_MOST_BYTES = 1_000_000


def load_settings(
    path: Path,
    what: str,
    kind: type[_Settings],
    prepare: Mapping[str, Callable[[dict[str, Any]], dict[str, Any]]] | None = None,
    complete: Callable[[dict[str, Any]], dict[str, Any]] | None = None,
) -> _Settings:
    """Read a YAML file and return its content as an instance of a dataclass.

    Parameters
    ----------
    path
        The file.
    what
        Kind of file, for error messages.
    kind
        Class of the result.
    prepare
        Functions that convert sections of the content, by section name.
    complete
        Function that completes the content before its sections are converted.

    Raises
    ------
    ValueError
        If the file cannot be read, or a value is missing, unknown or out of range; the message
        names the file.
    """
    try:
        content = load_yaml(path.expanduser(), _MOST_BYTES)
    except (OSError, RuntimeError) as error:
        # RuntimeError: the home folder of an unknown user.
        reason = getattr(error, "strerror", None) or error
        raise ValueError(f"{what} {path} cannot be read: {reason}") from error
    try:
        if complete is not None and isinstance(content, dict):
            content = complete(content)
        for section, change in (prepare or {}).items():
            if isinstance(content, dict) and isinstance(content.get(section), dict):
                content[section] = change(content[section])
        return settings_from(kind, content)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def settings_from(kind: type[_Settings], content: Any, section: str = "") -> _Settings:
    """Return an instance of a dataclass built from plain values, as parsed from a YAML file.

    A field that is itself a dataclass is a section of the file, which may be empty. A string in
    place of a section is used as its field ``source``.

    Raises
    ------
    ValueError
        If a name is unknown or missing, or a value is out of range; the message begins with the
        section.
    """
    definitions = {item.name: item for item in fields(cast(Any, kind))}
    hints = get_type_hints(kind)
    place = f"{section}: " if section else ""
    if isinstance(content, str) and "source" in definitions:
        content = {"source": content}
    if not isinstance(content, dict):
        actual = f"{section} = {content!r}: " if section else f"it contains {content!r}, "
        actual = "it is empty, " if content is None and not section else actual
        raise ValueError(f"{actual}expected a mapping with {', '.join(definitions)}")
    values = {}
    for name, value in content.items():
        if name not in definitions:
            raise ValueError(f"{place}{unknown_name('entry', name, definitions)}")
        part = next(filter(is_dataclass, (hints[name], *get_args(hints[name]))), None)
        if part is not None and value is None:
            continue
        values[name] = tuple(value) if isinstance(value, list) else value
        if part is not None:
            values[name] = settings_from(cast(Any, part), value, name)
        elif isinstance(definitions[name].default, int | float) and isinstance(value, str):
            # YAML 1.1 reads 1e5 as a string.
            with suppress(ValueError):
                number = float(value)
                is_whole = isinstance(definitions[name].default, int) and number.is_integer()
                values[name] = int(number) if is_whole else number
    for name, item in definitions.items():
        if item.default is item.default_factory is MISSING and name not in values:
            raise ValueError(f"{place}{name} is missing")
    try:
        return kind(**values)
    except ValueError as error:
        raise ValueError(f"{place}{error}") from error
