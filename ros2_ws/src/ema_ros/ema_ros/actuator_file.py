"""Description of an actuator from a YAML file."""

from pathlib import Path
from typing import Any

from ema_core.description import ActuatorDescription
from ema_core.linear import in_si
from ema_core.parameters import NEUTRAL
from ema_core.settings_file import load_settings


def load_description(path: Path, *, is_simulated: bool = False) -> ActuatorDescription:
    """Read a description from a YAML file; a ValueError names the file and its defect.

    It has ``actuator_id``, ``serial_number``, ``model``, ``sample_period`` [s], ``drive``,
    ``acquisition`` and ``parameters``, the last two mappings of names to values in SI units; with a
    ``lead`` [m], parameters may be texts as "60 mm", "100 mm/s", "200 N", "50 N.s/m" and "12 kg".
    Missing entries have the values of the built-in actuator. With ``drive: unknown``, parameters
    that are missing have the values of ``ema_core.parameters.NEUTRAL``: a file then needs
    ``actuator_id``, ``serial_number`` and ``drive`` alone.

    Parameters
    ----------
    is_simulated
        Whether a simulator reads it: a plant needs physical values, so that missing parameters
        have the built-in actuator's values for every drive.
    """
    return load_settings(
        path,
        "actuator file",
        ActuatorDescription,
        {"parameters": in_si},
        None if is_simulated else _completed,
    )


def _completed(content: dict[str, Any]) -> dict[str, Any]:
    """Return the content of a file, with neutral values for an unknown drive's missing ones."""
    given = content.get("parameters") or {}
    if content.get("drive") != "unknown" or not isinstance(given, dict):
        return content
    return {"model": ""} | content | {"parameters": dict(NEUTRAL) | given}
