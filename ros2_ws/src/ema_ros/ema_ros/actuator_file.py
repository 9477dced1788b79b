"""Description of an actuator from a YAML file."""

from dataclasses import fields
from pathlib import Path
from typing import Any

from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.wording import unknown_name
from ema_core.yaml_file import load_yaml

_NAMES = (
    *("actuator_id", "serial_number", "model", "sample_period", "drive"),
    *("acquisition", "parameters"),
)


def load_description(path: Path) -> ActuatorDescription:
    """Read a description from a YAML file; a ValueError names the file and what is wrong.

    It has ``actuator_id``, ``serial_number``, ``model``, ``sample_period`` [s], ``drive``,
    ``acquisition`` and ``parameters``, the last two mappings of names to values in SI units.
    Missing entries have the values of the built-in actuator.
    """
    try:
        content = load_yaml(path.expanduser())
    except OSError as error:
        raise ValueError(f"actuator file {path} cannot be read: {error.strerror}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected a mapping with {', '.join(_NAMES)}")
    for name in content:
        if name not in _NAMES:
            raise ValueError(f"{path}: {unknown_name('entry', name, _NAMES)}")
    parameters, acquisition = (
        _mapping(path, content, name) for name in ("parameters", "acquisition")
    )
    if "sample_period" in content:
        content["sample_period"] = _number(content["sample_period"])
    known = [item.name for item in fields(Acquisition)]
    for name in acquisition:
        if name not in known:
            raise ValueError(f"{path}: {unknown_name('entry of acquisition', name, known)}")
    try:
        return ActuatorDescription(
            parameters=ActuatorParameters().replace(parameters),
            acquisition=Acquisition(**acquisition),
            **content,
        )
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def _mapping(path: Path, content: dict[str, Any], name: str) -> dict[str, Any]:
    """Remove an entry that maps names to values, and return it; it may be missing."""
    entry = content.pop(name, None) or {}
    if not isinstance(entry, dict):
        raise ValueError(f"{path}: {name} must be a mapping of names to values")
    return {key: _number(value) for key, value in entry.items()}


def _number(value: Any) -> Any:
    """Return a number that YAML 1.1 reads as text, such as 1e5, as a float."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
