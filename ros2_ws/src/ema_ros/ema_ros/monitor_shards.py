# SPDX-License-Identifier: Apache-2.0
"""Names, parameters and parameter files of monitors that share the actuators."""

from pathlib import Path
from typing import Any, Final

import yaml

from ema_core.yaml_file import load_yaml

_MONITOR: Final = "monitor"
_PARAMETERS: Final = "ros__parameters"


def monitor_names(monitors: int) -> list[str]:
    """Return the names of the nodes: ``monitor`` for one, else ``monitor_0``, ``monitor_1``, ...

    Raises
    ------
    ValueError
        If ``monitors`` is less than 1.
    """
    if monitors < 1:
        raise ValueError(f"monitors = {monitors}: expected at least 1")
    return [_MONITOR] if monitors == 1 else [f"{_MONITOR}_{index}" for index in range(monitors)]


def shard_parameters(index: int, monitors: int) -> dict[str, int]:
    """Return the parameters that select a monitor's shard; empty for a single monitor."""
    return {"shard.index": index, "shard.count": monitors} if monitors > 1 else {}


def file_for(name: str, file: Path, folder: Path) -> Path:
    """Copy a parameter file with ``monitor`` replaced by another node name. Return the path.

    The copy is in ``folder``; if nothing is replaced, the path is ``file``. Parameter files name
    their node, and ROS has no pattern for a part of a name. Parameters of the file for the node
    name itself take precedence.

    Raises
    ------
    ValueError
        If the file is not YAML.
    """
    try:
        content = load_yaml(file)
    except ValueError as error:
        raise ValueError(f"{file}: expected a parameter file: {error}") from error
    if not isinstance(content, dict) or name == _MONITOR:
        return file
    changed = _named(content, name)
    if changed == content:
        return file
    copy = folder / f"{name}_{len(list(folder.iterdir()))}_{file.name}"
    text = yaml.safe_dump(changed, sort_keys=False, allow_unicode=True)
    copy.write_text(text, encoding="utf-8")
    return copy


def _named(nodes: dict[Any, Any], name: str) -> dict[Any, Any]:
    """Return sections by node or namespace, with sections of ``monitor`` renamed to ``name``."""
    sections: dict[Any, Any] = {}
    # Sections for the name itself come last, and so take precedence.
    for key, value in sorted(nodes.items(), key=lambda item: _last(item[0]) == name):
        if not isinstance(value, dict):
            sections[key] = value
        elif _PARAMETERS not in value:
            sections[key] = _named(value, name)
        else:
            is_general = _last(key) == _MONITOR
            renamed = f"{str(key).removesuffix(_MONITOR)}{name}" if is_general else key
            sections[renamed] = _merged(sections.get(renamed), value)
    return sections


def _last(key: Any) -> str:
    return str(key).rpartition("/")[2]


def _merged(general: Any, special: Any) -> Any:
    """Merge two sections; entries of ``special`` override entries of ``general``."""
    if not isinstance(general, dict) or not isinstance(special, dict):
        return special
    return {**general, **{key: _merged(general.get(key), value) for key, value in special.items()}}
