"""Description of an actuator from a YAML file."""

from pathlib import Path

from ema_core.description import ActuatorDescription
from ema_core.linear import in_si
from ema_core.settings_file import load_settings


def load_description(path: Path) -> ActuatorDescription:
    """Read a description from a YAML file; a ValueError names the file and what is wrong.

    It has ``actuator_id``, ``serial_number``, ``model``, ``sample_period`` [s], ``drive``,
    ``acquisition`` and ``parameters``, the last two mappings of names to values in SI units; with a
    ``lead`` [m], parameters may be texts as "60 mm", "100 mm/s", "200 N", "50 N.s/m" and "12 kg".
    Missing entries have the values of the built-in actuator.
    """
    return load_settings(path, "actuator file", ActuatorDescription, {"parameters": in_si})
