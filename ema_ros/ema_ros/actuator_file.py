"""Description of an actuator from a YAML file."""

from pathlib import Path
from typing import Any

import yaml

from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters

_NAMES = ("actuator_id", "serial_number", "model", "sample_period", "parameters")


def load_description(path: Path) -> ActuatorDescription:
    """Read a description.

    Parameters
    ----------
    path
        YAML file with ``actuator_id``, ``serial_number``, ``model``, ``sample_period`` [s] and
        ``parameters``, a mapping of names to values in SI units. Missing entries have the
        values of the built-in actuator.

    Raises
    ------
    ValueError
        When the file cannot be read or is no such mapping, or a name is unknown or a value
        impossible.
    """
    try:
        content = yaml.safe_load(path.expanduser().read_text())
    except OSError as error:
        raise ValueError(f"actuator file {path} cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not a YAML file: {error}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected a mapping with {', '.join(_NAMES)}")
    for name in content:
        if name not in _NAMES:
            raise ValueError(f"{path}: unknown entry {name!r}; known: {', '.join(_NAMES)}")
    parameters = content.pop("parameters", None) or {}
    if not isinstance(parameters, dict):
        raise ValueError(f"{path}: parameters must be a mapping of names to values")
    if "sample_period" in content:
        content["sample_period"] = _number(content["sample_period"])
    parameters = {name: _number(value) for name, value in parameters.items()}
    try:
        return ActuatorDescription(parameters=ActuatorParameters().replace(parameters), **content)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def _number(value: Any) -> Any:
    """Return a number that YAML 1.1 reads as text, such as 1e5, as a float."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
