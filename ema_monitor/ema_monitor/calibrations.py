"""Calibrations of either kind: making one, reading its file, and those of several units."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final
from urllib.parse import quote

from ema_core.description import ActuatorDescription, UnitKey
from ema_core.yaml_file import load_yaml
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.calibration.plausible import implausible
from ema_monitor.calibration.stored import MOST_BYTES, is_calibration_file
from ema_monitor.faulty_baseline import fault_instead
from ema_monitor.joint.window_baseline import WindowBaseline
from ema_monitor.windows.window import Window

AnyCalibration = Calibration | JointCalibration
"""Of a drive that is modelled, or of one whose controller is not."""

CALIBRATION_FILE: Final = "calibration.yaml"
"""Name of the calibration of the unit whose bags lie in the same folder."""

_SUFFIXES: Final = (".yaml", ".yml")


def load_calibration(path: Path) -> AnyCalibration:
    """Read a calibration of either kind.

    Raises
    ------
    ValueError
        When the file is no calibration; the message names file and defect.
    OSError
        When it cannot be read.
    """
    content = load_yaml(path, MOST_BYTES)
    if isinstance(content, dict) and content.get("format") == JointCalibration.FORMAT:
        return JointCalibration.of_content(path, content)
    return Calibration.of_content(path, content)


def calibrate(
    windows: Sequence[Window],
    description: ActuatorDescription | None = None,
    form: str | None = None,
    accepted_by: str = "",
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
    accepted_by
        Person who accepts a unit that is implausible for its description; "" to refuse it.

    Raises
    ------
    ValueError
        When there is no window, one has no excitation, another sample period than the first or
        other columns than the description says, the motion is too little, or the unit deviates
        impossibly far from its description, or implausibly far and no person accepts it.
    """
    description = description or ActuatorDescription()
    if description.drive == "unknown":
        return calibrate_joint(windows, description)
    made = calibrate_model(windows, description, form)
    reason = "" if accepted_by else implausible(made, windows[0])
    if not accepted_by and not reason:
        reason = fault_instead(made, windows, description)
    if reason:
        raise ValueError(
            f"the windows are implausible for a healthy unit of this description: {reason}; check "
            "unit and description, or name who accepts it: force and person of ~/calibrate, "
            "--accepted-by of `ema calibrate`"
        )
    return replace(made, baseline=WindowBaseline.of(one.telemetry for one in windows))


def with_labels_of(calibration: AnyCalibration, replaced: AnyCalibration) -> AnyCalibration:
    """Return a calibration with the labels of one that it replaces, if of the same unit."""
    one, other = ((item.actuator_id, item.serial_number) for item in (calibration, replaced))
    if one != other:
        return calibration
    if isinstance(calibration, JointCalibration) and isinstance(replaced, JointCalibration):
        return calibration.with_labels_of(replaced)
    if isinstance(calibration, Calibration) and isinstance(replaced, Calibration):
        return replace(calibration, baseline=calibration.baseline.with_labels_of(replaced.baseline))
    return calibration


class CalibrationStore:
    """Gives each actuator its calibration, and stores new ones.

    They are in ``file``, in which ``{actuator_id}`` and ``{serial_number}`` stand for those of the
    actuator; empty, the shipped calibration of the built-in actuator is used. Other names in
    braces, or a home that does not exist, are a ValueError. In ``own_folder`` a call may name a
    file, and new ones are stored there when neither ``file`` nor the call says where.
    """

    def __init__(self, file: str, own_folder: Path) -> None:
        self._file = file
        self._own_folder = own_folder
        self._in_use: dict[UnitKey, AnyCalibration] = {}
        self._set_path(ActuatorDescription())

    def of(self, description: ActuatorDescription) -> AnyCalibration | str:
        """Return the calibration of an actuator, or why there is none."""
        key = description.unit_key
        if key not in self._in_use and self._file:
            path = self._set_path(description)
            try:
                self._in_use[key] = load_calibration(path)
            except FileNotFoundError:
                return (
                    f"there is no calibration yet: {path} is missing; calibrate on the healthy unit"
                )
            except (ValueError, OSError) as error:
                return f"the calibration cannot be used: {error}"
        return self._in_use.get(key) or Calibration.builtin()

    def load(self, description: ActuatorDescription, file: str) -> tuple[AnyCalibration, Path]:
        """Use a calibration from a file from now on; return it, and where it came from.

        The file is in the own folder; empty, it is the usual place. Where it cannot be read, is no
        calibration, not of this unit, or elsewhere, ValueError or OSError say so, and the
        calibration in use stays.
        """
        path = self._place(description, file)
        calibration = load_calibration(path)
        if reason := calibration.unit_mismatch(description):
            raise ValueError(f"{path}: {reason}")
        self._in_use[description.unit_key] = calibration
        return calibration, path

    def prepare(self, description: ActuatorDescription, file: str) -> Path:
        """Return where a calibration is to be stored, and make the folder; the file as of ``load``.

        What is there and no calibration, and a folder that cannot be made, are ValueErrors as well.
        """
        path = self._place(description, file)
        if path.exists() and not is_calibration_file(path):
            raise ValueError(f"{path} is there, is no calibration and is not replaced")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _not_stored(path, error) from error
        return path

    def is_used_again(self, description: ActuatorDescription, path: Path) -> bool:
        """Return whether a file is that which an actuator's calibration is read from at a start."""
        return bool(self._file) and path.resolve() == self._set_path(description).resolve()

    def keep(
        self, description: ActuatorDescription, calibration: AnyCalibration, path: Path
    ) -> None:
        """Store a calibration and use it from now on; ValueError if it cannot be stored."""
        with suppress(OSError, ValueError):
            calibration = with_labels_of(calibration, load_calibration(path))
        try:
            calibration.save(path)
        except OSError as error:
            raise _not_stored(path, error) from error
        self._in_use[description.unit_key] = calibration

    def _place(self, description: ActuatorDescription, file: str) -> Path:
        if file:
            return self._called_path(file, description)
        if self._file:
            return self._set_path(description)
        name = f"calibration_{description.actuator_id}_{description.serial_number}.yaml"
        return self._own_folder / _as_file_name(name)

    def _set_path(self, description: ActuatorDescription) -> Path:
        """Return the path by the setting, which may be anywhere."""
        try:
            return Path(_filled(self._file, description)).expanduser()
        except (RuntimeError, ValueError) as error:
            raise ValueError(f"calibration_file = {self._file!r}: {error}") from error

    def _called_path(self, file: str, description: ActuatorDescription) -> Path:
        """Return the path that a call names, which any node of the graph can make."""
        try:
            path = (self._own_folder / _filled(file, description)).resolve()
        except (OSError, RuntimeError, ValueError) as error:
            raise ValueError(f"file = {file!r}: {error}") from error
        is_inside = path.is_relative_to(self._own_folder.resolve())
        if not is_inside or path.suffix not in _SUFFIXES or file.startswith("~"):
            raise ValueError(
                f"file = {file!r}: expected a name that ends in {' or '.join(_SUFFIXES)}, inside "
                f"{self._own_folder} (parameter calibration_folder)"
            )
        return path


def _not_stored(path: Path, error: OSError) -> ValueError:
    return ValueError(f"the calibration cannot be stored in {path}: {error.strerror}")


def _filled(path: str, description: ActuatorDescription) -> str:
    """Return a path with the names of an actuator in the places of their braces."""
    names = {
        "actuator_id": _as_file_name(description.actuator_id),
        "serial_number": _as_file_name(description.serial_number),
    }
    filled = re.sub(r"\{(\w+)\}", lambda found: names.get(found[1], found[0]), path)
    if "{" in filled or "}" in filled:  # names have none: they are quoted
        raise ValueError(
            "expected a path, in which {actuator_id} and {serial_number} may stand in braces"
        )
    return filled


def _as_file_name(name: str) -> str:
    """Return a name without anything that would lead into another folder."""
    return name.replace(".", "%2E") if name in (".", "..") else quote(name, safe=" ")
