"""Static calibration: what the model misses on a healthy actuator, added to it ever after."""

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from functools import cached_property
from importlib import resources
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.faults import healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.alignment import difference_at, moved, shift_between
from ema_monitor.model import FORMS, MonitorModel
from ema_monitor.residual import band_limited, rms
from ema_monitor.window import Window

_FORMAT = 1
_COMMAND_TOLERANCE = 5e-3
_LEAST_SCATTER = 1e-6
_RANGES = {
    "dt": ("s", 1e-9, 1e-3),
    "sample_period": ("s", 1e-9, 1.0),
    "lift": ("A", -1e3, 1e3),
    "healthy_rms": ("A", _LEAST_SCATTER, 1e4),
    "windows": ("", 1, 1e9),
}


@dataclass(frozen=True, eq=False)
class Calibration:
    """Static calibration of a monitor model for one unit, one command and one sample period.

    Attributes
    ----------
    actuator_id, serial_number
        The unit it was made on.
    parameters
        Nominal parameters that the model had.
    form, dt
        Form of the monitor model, and its step [s].
    sample_period
        Period of the telemetry [s].
    command
        Command of the window including that at the start, ``(n + 1,)`` [rad].
    lift
        Height of the step in current that the idle phase adds to the equivalent current [A].
    correction
        What the model with its lift still misses on the healthy actuator, ``(n,)`` [A].
    healthy_rms
        Rms of the band-limited residual that another healthy window has after correction [A];
        NaN when that is unknown: there was a single window, or all were equal.
    windows
        Number of windows averaged.

    Raises
    ------
    ValueError
        When a figure is impossible; the message names it.
    """

    actuator_id: str
    serial_number: str
    parameters: ActuatorParameters
    form: str
    dt: float
    sample_period: float
    command: NDArray[np.float64] = field(repr=False)
    lift: float
    correction: NDArray[np.float64] = field(repr=False)
    healthy_rms: float
    windows: int

    def __post_init__(self) -> None:
        for name in ("actuator_id", "serial_number", "form"):
            value = getattr(self, name)
            if not isinstance(value, str) or not value:
                raise ValueError(f"{name} = {value!r}: expected a name")
        for name, (unit, lowest, highest) in _RANGES.items():
            value = getattr(self, name)
            unknown = name == "healthy_rms" and isinstance(value, float) and np.isnan(value)
            if not isinstance(value, int | float) or not (lowest <= value <= highest or unknown):
                raise ValueError(
                    f"{name} = {value!r}: expected a number in [{lowest:g}, {highest:g}] {unit}"
                )
        for name in ("command", "correction"):
            row = getattr(self, name)
            if row.ndim != 1 or not np.all(np.isfinite(row)):
                raise ValueError(f"{name} is not a row of finite numbers")
        if len(self.command) != len(self.correction) + 1:
            raise ValueError(
                f"command has {len(self.command)} values, expected one more than the "
                f"{len(self.correction)} of correction"
            )
        self.model().steps(self.sample_period)

    @cached_property
    def calibration_id(self) -> str:
        """Identity of the content: the same figures give the same name."""
        text = json.dumps(self._as_mapping(), sort_keys=True)
        return f"{self.serial_number}-{hashlib.sha256(text.encode()).hexdigest()[:10]}"

    def model(self) -> MonitorModel:
        """Return the monitor model that this calibration belongs to."""
        return MonitorModel(self.parameters, self.form, self.dt)

    def apply(self, current: NDArray[np.float64], shift: int = 0) -> NDArray[np.float64]:
        """Return the measured current to expect where the model says ``current`` [A].

        Parameters
        ----------
        current
            Current of the model, ``(..., n)`` [A].
        shift
            How many samples later than the calibrated window the window begins.
        """
        lift = self.lift * lift_shape(current, self.parameters)
        return current + lift + moved(self.correction, shift)

    def alignment(self, window: Window) -> int:
        """Return how many samples later than the calibrated window a window begins.

        Parameters
        ----------
        window
            A window with as many samples as the calibration.
        """
        return shift_between(window.command, self.command)

    def unit_mismatch(self, description: ActuatorDescription) -> str:
        """Return why this calibration does not fit a described actuator; empty when it does.

        Parameters
        ----------
        description
            The actuator at hand.
        """
        reasons = []
        if description.serial_number != self.serial_number:
            reasons.append(
                f"the actuator has serial number {description.serial_number!r}, the calibration "
                f"was made on {self.serial_number!r}"
            )
        mine, theirs = self.parameters.as_mapping(), description.parameters.as_mapping()
        reasons += [
            f"the actuator has {name} = {theirs[name]:g}, the calibration {mine[name]:g}"
            for name in mine
            if not np.isclose(mine[name], theirs[name], rtol=1e-9, atol=0.0)
        ]
        return "; ".join(reasons)

    def shape_mismatch(self, window: Window) -> str:
        """Return why the samples of a window are not those calibrated; empty when they are.

        Parameters
        ----------
        window
            The window to be diagnosed.
        """
        if abs(window.sample_period / self.sample_period - 1.0) > 1e-6:
            return (
                f"the sample period is {window.sample_period:g} s, the calibration's "
                f"{self.sample_period:g} s"
            )
        if len(window) != len(self.correction):
            return f"the window has {len(window)} samples, the calibration {len(self.correction)}"
        return ""

    def command_mismatch(self, window: Window) -> str:
        """Return why a window's command is not the calibrated one; empty when it is.

        Parameters
        ----------
        window
            A window with as many samples as the calibration.
        """
        difference = difference_at(window.command, self.command, self.alignment(window))
        limit = _COMMAND_TOLERANCE * rms(self.command)
        if difference > limit:
            return (
                f"the command differs from the calibrated one by {difference:.3g} rad rms "
                f"(limit {limit:.3g} rad): calibrate with this command"
            )
        return ""

    def save(self, path: Path) -> None:
        """Write the calibration to a YAML file.

        Parameters
        ----------
        path
            File to write; an existing one is replaced only once the new one is complete.
        """
        partial = path.with_suffix(path.suffix + ".partial")
        partial.write_text(
            yaml.safe_dump(self._as_mapping(), sort_keys=False, default_flow_style=None, width=96)
        )
        partial.replace(path)

    @classmethod
    def builtin(cls) -> "Calibration":
        """Return the shipped calibration of the built-in actuator under the thesis's chirp."""
        with resources.as_file(resources.files("ema_monitor") / "builtin_calibration.yaml") as path:
            return cls.load(path)

    @classmethod
    def load(cls, path: Path) -> "Calibration":
        """Read a calibration from a YAML file.

        Parameters
        ----------
        path
            File written by ``save``.

        Raises
        ------
        ValueError
            When the file is no calibration; the message names file and defect.
        OSError
            When it cannot be read.
        """
        try:
            content = yaml.load(
                path.read_text(), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)
            )
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise ValueError(f"{path} is not a YAML file: {error}") from error
        if not isinstance(content, dict) or content.get("format") != _FORMAT:
            raise ValueError(f"{path} is not a calibration of format {_FORMAT}")
        content.pop("format")
        try:
            given = content["parameters"]
            content["parameters"] = ActuatorParameters.from_mapping(given)
            for name in content["parameters"].as_mapping():
                if name not in given:
                    raise ValueError(f"parameter {name} is missing")
            for name in ("command", "correction"):
                content[name] = np.array(content[name], dtype=np.float64)
            return cls(**content)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} is a damaged calibration: {error}") from error

    def _as_mapping(self) -> dict[str, Any]:
        content = {"format": _FORMAT, **asdict(self)}
        content["command"] = [round(float(value), 9) for value in self.command]
        content["correction"] = [round(float(value), 5) for value in self.correction]
        content["healthy_rms"] = float(self.healthy_rms)
        return content


def lift_shape(current: NDArray[np.float64], parameters: ActuatorParameters) -> NDArray[np.float64]:
    """Return how the idle phase lifts the equivalent current, for a lift of 1 A.

    The idle phase is regulated about zero and still carries ripple, which the equivalent current
    counts with the sign of the torque; within the hysteresis band that sign itself changes with
    the ripple (M12).

    Parameters
    ----------
    current
        Current of the model, ``(..., n)`` [A].
    parameters
        Nominal parameters of the actuator.
    """
    return np.clip(current / parameters.h_b, -1.0, 1.0)


def calibrate(
    windows: Iterable[Window], description: ActuatorDescription, form: str = "fast"
) -> Calibration:
    """Calibrate the monitor model on healthy windows of one actuator.

    Parameters
    ----------
    windows
        Windows of the same command, at least one; more average out the PWM's ripple.
    description
        The unit that the windows were taken from.
    form
        Form of the monitor model. The lift is fitted for the "fast" form only: the thesis's
        calibration, which goes with the "source" form, is the correction alone.

    Raises
    ------
    ValueError
        When there is no window, or one is not like the first.
    """
    waiting = iter(windows)
    first = next(waiting, None)
    if first is None:
        raise ValueError("calibration needs at least one healthy window, got none")
    h = first.sample_period
    # The longest step up to the form's own that divides the sample period.
    model = MonitorModel(description.parameters, form, h / math.ceil(h / FORMS[form] - 1e-6))
    modelled, missed = [], []
    for number, window in enumerate(chain([first], waiting)):
        if reason := window.excitation_defect() or _unlike(window, first):
            raise ValueError(f"window {number}: {reason}")
        play = 0.0 if window.play is None else window.play
        current = model.current(window, healthy_faults(), play)[0]
        shift = shift_between(window.command, first.command)
        modelled.append(moved(current, -shift))
        missed.append(moved(window.current - current, -shift))
    residuals, n = np.array(missed), len(missed)
    lift = 0.0
    if model.form == "fast":
        shape = lift_shape(np.array(modelled), model.parameters)
        lift = float(np.sum(shape * residuals) / np.sum(shape**2))
        residuals -= lift * shape
    correction = np.mean(residuals, axis=0)
    scatter = 0.0
    if n > 1:
        spread = rms(np.array([band_limited(row, h) for row in residuals - correction]))
        # Each window is itself in the mean that it is compared with; another one will not be.
        scatter = spread * np.sqrt((n + 1.0) / (n - 1.0))
    return Calibration(
        description.actuator_id,
        description.serial_number,
        model.parameters,
        model.form,
        model.dt,
        h,
        first.command,
        lift,
        correction,
        scatter if scatter > _LEAST_SCATTER else float("nan"),
        n,
    )


def _unlike(window: Window, first: Window) -> str:
    """Return in what a window is not like the first; empty when it is."""
    if len(window) != len(first) or window.sample_period != first.sample_period:
        return (
            f"it has {len(window)} samples of {window.sample_period:g} s, the first "
            f"{len(first)} of {first.sample_period:g} s"
        )
    shift = shift_between(window.command, first.command)
    difference = difference_at(window.command, first.command, shift)
    limit = _COMMAND_TOLERANCE * rms(first.command)
    if difference > limit:
        return (
            f"it has another command than the first: {difference:.3g} rad rms apart (limit "
            f"{limit:.3g} rad)"
        )
    return ""
