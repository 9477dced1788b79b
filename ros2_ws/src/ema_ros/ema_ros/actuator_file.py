# SPDX-License-Identifier: Apache-2.0
"""Description of an actuator from a YAML file."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from ema_core.description import ActuatorDescription
from ema_core.linear import in_si
from ema_core.parameters import NEUTRAL, ActuatorParameters
from ema_core.settings_file import load_settings

UNKNOWN_SERIAL: Final = "unknown"
"""Serial number of joints whose serial number is not specified."""

_JOINT: Final = "{joint}"


def load_description(path: Path, *, is_simulated: bool = False) -> ActuatorDescription:
    """Read the description of an actuator from a YAML file.

    The entries are ``actuator_id``, ``serial_number``, ``model``, ``sample_period`` [s], ``drive``,
    ``acquisition`` and ``parameters``. The last two are mappings of names to values in SI units;
    with a ``lead`` [m], parameters may be strings with units, such as "60 mm", "100 mm/s", "200 N",
    "50 N.s/m" and "12 kg". Missing entries default to the built-in actuator. With ``drive:
    unknown``, missing parameters have the values of ``ema_core.parameters.NEUTRAL``: the file then
    only needs ``actuator_id``, ``serial_number`` and ``drive``.

    Parameters
    ----------
    path
        The file.
    is_simulated
        Whether a simulator reads the file. A plant needs physical values: missing parameters then
        have the values of the built-in actuator for every drive.

    Raises
    ------
    ValueError
        If the file cannot be read, or a value is missing, unknown or out of range; the message
        names the file.
    """
    return load_settings(
        path,
        "actuator file",
        ActuatorDescription,
        {"parameters": in_si},
        None if is_simulated else _completed,
    )


def load_descriptions(file: str, joints: Sequence[str]) -> list[ActuatorDescription]:
    """Return the description of each joint, or of a single actuator without joints.

    Each joint's name is its actuator's name, and replaces ``{joint}`` in the file name. Without a
    file, a single actuator is the built-in actuator, and joints have an unknown drive.

    Raises
    ------
    ValueError
        If a file is not a description; the message names it.
    """
    if not joints:
        return [load_description(Path(file)) if file else ActuatorDescription()]
    if not file:
        neutral = replace(ActuatorParameters(), **NEUTRAL)
        return [
            ActuatorDescription(joint, UNKNOWN_SERIAL, "", drive="unknown", parameters=neutral)
            for joint in joints
        ]
    return [
        replace(load_description(Path(file.replace(_JOINT, joint))), actuator_id=joint)
        for joint in joints
    ]


def _completed(content: dict[str, Any]) -> dict[str, Any]:
    """Return file content with missing values of an unknown drive set to neutral values."""
    parameters = content.get("parameters") or {}
    if content.get("drive") != "unknown" or not isinstance(parameters, dict):
        return content
    return {"model": ""} | content | {"parameters": dict(NEUTRAL) | parameters}
