"""Calibrations of either kind: making one of healthy windows, and reading its file."""

from collections.abc import Sequence
from pathlib import Path

from ema_core.description import ActuatorDescription
from ema_core.yaml_file import load_yaml
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.current_balance.calibrating import calibrate_unknown
from ema_monitor.current_balance.unit import UnknownDriveUnit
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
    if isinstance(content, dict) and content.get("format") == UnknownDriveUnit.FORMAT:
        return UnknownDriveUnit.of_content(path, content)
    return Calibration.of_content(path, content)


def calibrate(
    windows: Sequence[Window],
    description: ActuatorDescription | None = None,
    form: str | None = None,
) -> AnyCalibration:
    """Calibrate on healthy windows of one actuator, as its drive wants it.

    Parameters
    ----------
    windows
        Healthy windows, at least one; of a test cycle, ten or more average out the PWM's ripple.
        They are used one at a time, several times over. What was measured beside them is taken
        for known, within its sigma.
    description
        The unit that the windows were taken from; the built-in actuator when None.
    form
        Form of the monitor model, that of the drive when None; it does not matter where the drive
        is unknown.

    Raises
    ------
    ValueError
        When there is no window, one has no excitation, another sample period than the first or
        other columns than the description says, the motion is too little, or the unit deviates
        impossibly far from its description.
    """
    description = description or ActuatorDescription()
    if description.drive == "unknown":
        return calibrate_unknown(windows, description)
    return calibrate_model(windows, description, form)
