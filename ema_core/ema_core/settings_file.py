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
    """Read a dataclass from a YAML file; ``what`` names the kind of file in errors.

    ``complete`` adds to the content of the file. After that, ``prepare`` changes sections of it.

    Raises
    ------
    ValueError
        When the file cannot be read or does not hold one; the message names the file.
    """
    try:
        content = load_yaml(path.expanduser(), _MOST_BYTES)
    except (OSError, RuntimeError) as error:
        # RuntimeError: a home folder of nobody
        why = getattr(error, "strerror", None) or error
        raise ValueError(f"{what} {path} cannot be read: {why}") from error
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
    """Return the dataclass of plain values, as a YAML file holds them.

    A dataclass in it is a section, which may be empty; a text stands for the ``source`` of one.

    Raises
    ------
    ValueError
        When a name is unknown, one is missing or a value impossible; the message begins with the
        section.
    """
    known = {item.name: item for item in fields(cast(Any, kind))}
    hints = get_type_hints(kind)
    place = f"{section}: " if section else ""
    if isinstance(content, str) and "source" in known:
        content = {"source": content}
    if not isinstance(content, dict):
        given = f"{section} = {content!r}: " if section else f"it holds {content!r}, "
        given = "it is empty, " if content is None and not section else given
        raise ValueError(f"{given}expected a mapping with {', '.join(known)}")
    values = {}
    for name, value in content.items():
        if name not in known:
            raise ValueError(f"{place}{unknown_name('entry', name, known)}")
        part = next(filter(is_dataclass, (hints[name], *get_args(hints[name]))), None)
        if part is not None and value is None:
            continue
        values[name] = tuple(value) if isinstance(value, list) else value
        if part is not None:
            values[name] = settings_from(cast(Any, part), value, name)
        elif isinstance(known[name].default, int | float) and isinstance(value, str):
            # YAML 1.1 reads 1e5 as a text.
            with suppress(ValueError):
                number = float(value)
                is_whole = isinstance(known[name].default, int) and number.is_integer()
                values[name] = int(number) if is_whole else number
    for name, item in known.items():
        if item.default is item.default_factory is MISSING and name not in values:
            raise ValueError(f"{place}{name} is missing")
    try:
        return kind(**values)
    except ValueError as error:
        raise ValueError(f"{place}{error}") from error
