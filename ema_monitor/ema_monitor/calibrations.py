"""Calibrations of either kind: making one of healthy windows, and reading its file."""

from collections.abc import Sequence
from pathlib import Path

from ema_core.description import ActuatorDescription
from ema_core.yaml_file import load_yaml
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.files import built_of
from ema_monitor.calibration.fit import calibrate
from ema_monitor.current_balance.calibrating import calibrate_unknown
from ema_monitor.current_balance.unit import FORMAT, UnknownDriveUnit
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
    content = load_yaml(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        return Calibration.of_content(path, content)
    return built_of(path, content, UnknownDriveUnit.of_mapping)


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
