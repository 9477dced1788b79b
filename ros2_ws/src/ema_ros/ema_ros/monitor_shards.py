"""Several monitors that share the actuators: their names, parameters and parameter files."""

from pathlib import Path
from typing import Any, Final

import yaml

from ema_core.yaml_file import load_yaml

_MONITOR: Final = "monitor"
_PARAMETERS: Final = "ros__parameters"


def monitor_names(monitors: int) -> list[str]:
    """Return the names of the nodes: ``monitor`` alone, or ``monitor_0`` and on."""
    if monitors < 1:
        raise ValueError(f"monitors = {monitors}: expected at least 1")
    return [_MONITOR] if monitors == 1 else [f"{_MONITOR}_{index}" for index in range(monitors)]


def shard_parameters(index: int, monitors: int) -> dict[str, int]:
    """Return the parameters by which a monitor follows its share; none when it is alone."""
    return {"shard.index": index, "shard.count": monitors} if monitors > 1 else {}


def file_for(name: str, file: Path, folder: Path) -> Path:
    """Return a parameter file in which what is meant for ``monitor`` is meant for another name.

    Parameter files name their node, and ROS knows no pattern for a part of a name. What the file
    has for the very name overrides.
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
    """Return sections by node, or by namespace, with those of ``monitor`` for another name."""
    found: dict[Any, Any] = {}
    # What is for the name itself comes after what is for all, and overrides it.
    for key, value in sorted(nodes.items(), key=lambda item: _last(item[0]) == name):
        if not isinstance(value, dict):
            found[key] = value
        elif _PARAMETERS not in value:
            found[key] = _named(value, name)
        else:
            is_general = _last(key) == _MONITOR
            own = f"{str(key).removesuffix(_MONITOR)}{name}" if is_general else key
            found[own] = _merged(found.get(own), value)
    return found


def _last(key: Any) -> str:
    return str(key).rpartition("/")[2]


def _merged(general: Any, own: Any) -> Any:
    """Return a section with what another one overrides in it."""
    if not isinstance(general, dict) or not isinstance(own, dict):
        return own
    return {**general, **{key: _merged(general.get(key), value) for key, value in own.items()}}
