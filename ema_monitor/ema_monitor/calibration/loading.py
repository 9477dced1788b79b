"""Calibrations of either kind: making one of healthy windows, and reading its file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from ema_core.description import ActuatorDescription
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate
from ema_monitor.unknown_drive.calibrating import calibrate_unknown
from ema_monitor.unknown_drive.unit import FORMAT, UnknownDriveUnit
from ema_monitor.windows.window import Window

AnyCalibration = Calibration | UnknownDriveUnit
"""Of a drive that is modelled, or of one whose controller is unknown."""


def load_calibration(path: Path) -> AnyCalibration:
    """Read a calibration of either kind.

    Raises
    ------
    ValueError
        When the file is no calibration; the message names file and defect.
    OSError
        When it cannot be read.
    """
    with path.open("rb") as file:
        is_unknown_drive = file.readline().strip() == f"format: {FORMAT}".encode()
    if not is_unknown_drive:
        return Calibration.load(path)
    try:
        content: dict[str, Any] = yaml.load(
            path.read_text(), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        )
        return UnknownDriveUnit.of_mapping(content)
    except (AttributeError, KeyError, TypeError, ValueError, yaml.YAMLError) as error:
        raise ValueError(f"{path} is a damaged calibration: {error}") from error


def calibrate_unit(
    windows: Sequence[Window], description: ActuatorDescription, form: str | None = None
) -> AnyCalibration:
    """Calibrate on healthy windows of one actuator, as its drive wants it.

    Parameters
    ----------
    windows, description, form
        As of `calibrate`; ``form`` does not matter where the drive is unknown.

    Raises
    ------
    ValueError
        As of `calibrate` and `calibrate_unknown`.
    """
    if description.drive == "unknown":
        return calibrate_unknown(windows, description)
    return calibrate(windows, description, form)
