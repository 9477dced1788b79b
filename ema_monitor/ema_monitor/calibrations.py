# SPDX-License-Identifier: Apache-2.0
"""Calibrations of modelled and unknown drives: fit, files, and a store for several units."""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final
from urllib.parse import quote

from ema_core.description import ActuatorDescription, UnitKey
from ema_core.expecting import require_type, value_or_default
from ema_core.yaml_file import load_yaml
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.calibration.plausible import implausible
from ema_monitor.calibration.stored import MOST_BYTES, is_calibration_file
from ema_monitor.faulty_baseline import fault_instead
from ema_monitor.joint.window_baseline import WindowBaseline
from ema_monitor.reason_texts import differences_text
from ema_monitor.reasons import CalibrationMissing, CalibrationUnusable, NoCalibration
from ema_monitor.windows.window import Window

AnyCalibration = Calibration | JointCalibration
"""Calibration of a modelled drive, or of a unit with an unknown drive."""

CALIBRATIONS: Final = (Calibration, JointCalibration)
"""Types of calibrations."""

CALIBRATION_FILE: Final = "calibration.yaml"
"""Name of the calibration file in the folder of a unit's bags."""

_SUFFIXES: Final = (".yaml", ".yml")
_WINDOWS_HINT: Final = "find_windows(telemetry) returns windows"


def load_calibration(path: str | Path) -> AnyCalibration:
    """Return the calibration read from a file, for a modelled or an unknown drive.

    Raises
    ------
    ValueError
        If ``path`` has a wrong type, or the file is not a calibration; the message names file and
        defect.
    OSError
        If the file cannot be read.
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
    """Return the calibration of an actuator, fitted to its healthy windows.

    Parameters
    ----------
    windows
        Healthy windows, at least one. Ten or more windows of a test cycle average out the PWM
        ripple. The fit reads them one at a time, several times over. Measured causes enter with
        their sigma.
    description
        Description of the unit; None for the built-in actuator.
    form
        Form of the monitor model; the default form of the drive if None. It is ignored if the
        drive is unknown.
    accepted_by
        Person who accepts a unit that is implausible for its description; "" to refuse it. It is
        ignored if the drive is unknown.

    Raises
    ------
    ValueError
        If an argument has a wrong type, or there is no window.
        If the motion of a window is too small, its sample period differs from the first window, or
        its columns differ from the description.
        If the unit deviates impossibly far from its description, or implausibly far and no person
        accepts it.
    """
    require_type("windows", windows, Sequence, _WINDOWS_HINT)
    for window in windows if isinstance(windows, list | tuple) else ():
        require_type("window", window, Window, _WINDOWS_HINT)
    description = value_or_default(
        "description", description, ActuatorDescription, ActuatorDescription
    )
    if not description.is_modelled:
        return calibrate_joint(windows, description)
    calibration = calibrate_model(windows, description, form)
    reason = "" if accepted_by else implausible(calibration, windows[0])
    if not accepted_by and not reason:
        reason = fault_instead(calibration, windows, description)
    if reason:
        raise ValueError(
            f"the windows are implausible for a healthy unit of this description: {reason}; check "
            "unit and description, or state who accepts it (accepted_by; --accepted-by of "
            "`ema calibrate`; force and person of ~/calibrate)"
        )
    return replace(calibration, baseline=WindowBaseline.of(window.telemetry for window in windows))


def with_labels_of(calibration: AnyCalibration, replaced: AnyCalibration) -> AnyCalibration:
    """Return a calibration with the labels of the calibration that it replaces.

    It is returned unchanged if the replaced calibration belongs to a different unit.
    """
    unit, replaced_unit = (
        (item.actuator_id, item.serial_number) for item in (calibration, replaced)
    )
    if unit != replaced_unit:
        return calibration
    if isinstance(calibration, JointCalibration) and isinstance(replaced, JointCalibration):
        return calibration.with_labels_of(replaced)
    if isinstance(calibration, Calibration) and isinstance(replaced, Calibration):
        return replace(calibration, baseline=calibration.baseline.with_labels_of(replaced.baseline))
    return calibration


class CalibrationStore:
    """Calibrations of the actuators of a monitor, and their files.

    Parameters
    ----------
    file
        Path of an actuator's calibration, with placeholders ``{actuator_id}`` and
        ``{serial_number}``; empty for the shipped calibration of the built-in actuator.
    folder
        Folder for files named in a call, and for new calibrations if neither ``file`` nor the call
        names a path.
    learned_file
        Like ``file``, for units with an unknown drive, whose baselines are learned; empty for
        ``file``.

    Raises
    ------
    ValueError
        If ``file`` has unknown placeholders or refers to a home folder that does not exist.
    """

    def __init__(self, file: str, folder: Path, learned_file: str = "") -> None:
        self._file = file
        self._folder = folder
        self._learned_file = learned_file
        self._in_use: dict[UnitKey, AnyCalibration] = {}
        self._set_path(ActuatorDescription())

    def of(self, description: ActuatorDescription) -> AnyCalibration | CalibrationMissing:
        """Return the calibration of an actuator, or the reason why it has none.

        Without a calibration in use or a path in the settings, the shipped calibration is returned.
        """
        key = description.unit_key
        if key not in self._in_use and self._pattern(description):
            path = self._set_path(description)
            try:
                self._in_use[key] = load_calibration(path)
            except FileNotFoundError:
                return NoCalibration(str(path))
            except (ValueError, OSError) as error:
                return CalibrationUnusable(str(error))
        return self._in_use.get(key) or Calibration.builtin()

    def use(self, description: ActuatorDescription, calibration: JointCalibration | None) -> None:
        """Use a learned baseline as the calibration of a unit; None removes the baseline in use."""
        if calibration is None:
            self._in_use.pop(description.unit_key, None)
        else:
            self._in_use[description.unit_key] = calibration

    def load(self, description: ActuatorDescription, file: str) -> tuple[AnyCalibration, Path]:
        """Read an actuator's calibration from a file and use it. Return it with its path.

        If an error is raised, the calibration in use remains.

        Parameters
        ----------
        description
            The actuator.
        file
            Path inside the folder of the store; empty for the default path of the actuator.

        Raises
        ------
        ValueError
            If the file is outside the folder, does not exist, is not a calibration, or belongs to a
            different unit.
        OSError
            If the file cannot be read.
        """
        path = self._place(description, file)
        try:
            calibration = load_calibration(path)
        except FileNotFoundError as error:
            raise ValueError(
                f"calibration file {path} does not exist: calibrate on the healthy unit, or name a "
                f"file in calibration_folder = {self._folder}"
            ) from error
        if differences := calibration.unit_mismatch(description):
            raise ValueError(f"{path}: {differences_text(differences)}")
        self._in_use[description.unit_key] = calibration
        return calibration, path

    def prepare(self, description: ActuatorDescription, file: str) -> Path:
        """Return the path for a new calibration of an actuator, creating its folder.

        Parameters
        ----------
        description
            The actuator.
        file
            Path inside the folder of the store; empty for the default path of the actuator.

        Raises
        ------
        ValueError
            If the path is outside the folder or an existing file that is not a calibration, or if
            the folder cannot be created.
        """
        path = self._place(description, file)
        if path.exists() and not is_calibration_file(path):
            raise ValueError(f"{path} exists and is not a calibration; it was not overwritten")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _not_stored(path, error) from error
        return path

    def is_used_again(self, description: ActuatorDescription, path: Path) -> bool:
        """Return whether the store loads an actuator's calibration from this file at startup."""
        is_set = bool(self._pattern(description))
        return is_set and path.resolve() == self._set_path(description).resolve()

    def keep(
        self, description: ActuatorDescription, calibration: AnyCalibration, path: Path
    ) -> None:
        """Write a calibration to a file and use it.

        If the file contains a calibration of the same unit, its labels are kept.

        Raises
        ------
        ValueError
            If the file cannot be written.
        """
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
        if self._pattern(description):
            return self._set_path(description)
        name = f"calibration_{description.actuator_id}_{description.serial_number}.yaml"
        return self._folder / file_name(name)

    def _set_path(self, description: ActuatorDescription) -> Path:
        """Return the path given by the setting; it may be outside the folder."""
        pattern = self._pattern(description)
        try:
            return Path(_filled(pattern, description)).expanduser()
        except (RuntimeError, ValueError) as error:
            raise ValueError(f"calibration_file = {pattern!r}: {error}") from error

    def _pattern(self, description: ActuatorDescription) -> str:
        """Return the path of an actuator's calibration with its placeholders; empty if none."""
        is_learned = not description.is_modelled and self._learned_file
        return self._learned_file if is_learned else self._file

    def _called_path(self, file: str, description: ActuatorDescription) -> Path:
        """Return the path named in a call, which must be inside the folder: any node may call."""
        try:
            path = (self._folder / _filled(file, description)).resolve()
        except (OSError, RuntimeError, ValueError) as error:
            raise ValueError(f"file = {file!r}: {error}") from error
        is_inside = path.is_relative_to(self._folder.resolve())
        if not is_inside or path.suffix not in _SUFFIXES or file.startswith("~"):
            raise ValueError(
                f"file = {file!r}: expected a name that ends in {' or '.join(_SUFFIXES)}, inside "
                f"{self._folder} (parameter calibration_folder)"
            )
        return path


def _not_stored(path: Path, error: OSError) -> ValueError:
    return ValueError(f"the calibration cannot be stored in {path}: {error.strerror}")


def _filled(path: str, description: ActuatorDescription) -> str:
    """Return a path with its placeholders replaced by an actuator's names."""
    names = {
        "actuator_id": file_name(description.actuator_id),
        "serial_number": file_name(description.serial_number),
    }
    filled = re.sub(r"\{(\w+)\}", lambda match: names.get(match[1], match[0]), path)
    if "{" in filled or "}" in filled:  # the names are quoted and contain no braces
        raise ValueError(
            "expected a path, with {actuator_id} and {serial_number} as the only placeholders"
        )
    return filled


def file_name(name: str) -> str:
    """Return a name as a file name, with characters escaped that could lead to another folder."""
    return name.replace(".", "%2E") if name in (".", "..") else quote(name, safe=" ")
