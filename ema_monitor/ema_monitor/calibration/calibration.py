# SPDX-License-Identifier: Apache-2.0
"""Calibration of the monitor model for one unit, and its file format."""

import math
from dataclasses import asdict, dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple, Self

import numpy as np

from ema_core.acquisition import USUAL, Acquisition
from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters, FieldOrientedParameters
from ema_core.quantity import is_finite_number
from ema_core.wording import counted
from ema_core.yaml_file import load_yaml
from ema_monitor.calibration.alignment import moved, shift_if_same
from ema_monitor.calibration.stored import MOST_BYTES, StoredCalibration, numbers
from ema_monitor.joint.window_baseline import WindowBaseline
from ema_monitor.model.deviations import N_DEVIATIONS, NAMES, Deviations, unit_priors
from ema_monitor.model.monitor_model import FORMS_OF_DRIVES, MonitorModel, Response
from ema_monitor.reasons import ColumnsContradict, Difference, Reason
from ema_monitor.windows.window import Window

LEAST_SCATTER: Final = 1e-6
"""Scatter below which windows count as duplicates, so that the scatter is unknown [A, rad/s]."""

# A deviation is not learned if its standard deviation exceeds this share of the prior's sigma.
_LEARNED = 0.7
_SAME_SCALE = 0.015
# Key of the baseline in the hashed content, and in files that earlier versions wrote in format 4.
_IDENTIFIED_AS = "normal"
_ROWS = ("command", "correction", "speed_correction")
_SCATTERS = ("healthy_rms", "healthy_speed_rms", "model_rms", "model_speed_rms")
_RANGES = {
    "dt": ("s", 1e-9, 1e-3),
    "sample_period": ("s", 1e-9, 1.0),
    "healthy_rms": ("A", LEAST_SCATTER, 1e4),
    "healthy_speed_rms": ("rad/s", LEAST_SCATTER, 1e6),
    "model_rms": ("A", LEAST_SCATTER, 1e4),
    "model_speed_rms": ("rad/s", LEAST_SCATTER, 1e6),
    "windows": ("", 1, 1e9),
}


class HealthyReference(NamedTuple):
    """Expected residuals of the model in a healthy window."""

    knows_command: bool
    """Whether the window has the calibrated command."""
    corrections: Response
    """Corrections to add to the modelled current and speed, ``(n,)`` each [A, rad/s]; zeros for
    other commands."""
    scatter: tuple[float, float]
    """Rms residuals of current and speed [A, rad/s]: corrected for the calibrated command,
    uncorrected for other commands."""


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(StoredCalibration):
    """Calibration of a monitor model for one unit and one sample period.

    The deviations of the unit change the model itself, so that they also apply to faulty states and
    other commands. The mean residual in healthy windows corrects the response to the calibrated
    command; for other commands, it counts as scatter.
    """

    FORMAT: ClassVar = 4

    actuator_id: str
    serial_number: str
    """Identifiers of the calibrated actuator and unit."""
    parameters: ActuatorParameters
    """Nominal parameters of the model."""
    form: str
    """Form of the monitor model."""
    dt: float
    """Integration step of the monitor model [s]."""
    sample_period: float
    """Sample period of the telemetry [s]."""
    command: Array = field(repr=False)
    """Command of the first window, including the command at its start, ``(n + 1,)`` [rad]."""
    unit: Deviations
    """Deviations of the unit from nominal."""
    unit_covariance: Array = field(repr=False)
    """Covariance of the deviations, ``(25, 25)``, including deviations that were not fitted; 0 if
    no deviations were fitted."""
    correction: Array = field(repr=False)
    speed_correction: Array = field(repr=False)
    """Mean residuals of the fitted model in current and speed, both ``(n,)`` [A, rad/s]."""
    healthy_rms: float
    healthy_speed_rms: float
    """Expected band-limited rms residuals of current and speed in a further healthy window, after
    the correction [A, rad/s]; NaN if unknown, as after a single window or identical windows."""
    model_rms: float
    model_speed_rms: float
    """Expected band-limited rms residuals of current and speed in a healthy window with another
    command, without the correction [A, rad/s]; NaN if unknown."""
    windows: int
    """Number of healthy windows."""
    travel_ratio: float = math.nan
    """Ratio of user-shaft travel to geared motor travel in healthy windows, from the position and
    speed sensors [-]; NaN if unknown."""
    law_offset: float = math.nan
    """Measured position minus the position that the control law implies, in healthy windows [rad];
    NaN if unknown."""
    acquisition: Acquisition = USUAL
    """Acquisition of the telemetry."""
    baseline: WindowBaseline = field(default=WindowBaseline(), repr=False)
    """Figures of the healthy windows, for the comparison with later windows; may be empty."""

    def __post_init__(self) -> None:
        for name in ("actuator_id", "serial_number", "form"):
            value = getattr(self, name)
            if not isinstance(value, str) or not value:
                raise ValueError(f"{name} = {value!r}: expected a name")
        for name, (unit, lowest, highest) in _RANGES.items():
            value = getattr(self, name)
            unknown = name in _SCATTERS and isinstance(value, float) and np.isnan(value)
            if not isinstance(value, int | float) or not (lowest <= value <= highest or unknown):
                raise ValueError(
                    f"{name} = {value!r}: expected a number in [{lowest:g}, {highest:g}] {unit}"
                )
        for name, value in self.unit._asdict().items():
            if not is_finite_number(value):
                raise ValueError(f"unit: {name} = {value!r}: expected a finite number")
        if self.unit_covariance.shape != (N_DEVIATIONS, N_DEVIATIONS):
            raise ValueError(
                f"unit_covariance has shape {self.unit_covariance.shape}, expected "
                f"({N_DEVIATIONS}, {N_DEVIATIONS})"
            )
        for name in _ROWS:
            row = getattr(self, name)
            if row.ndim != 1 or not np.all(np.isfinite(row)):
                raise ValueError(f"{name} is not a one-dimensional array of finite numbers")
        for name in _ROWS[1:]:
            if len(self.command) != len(getattr(self, name)) + 1:
                raise ValueError(
                    f"command has {len(self.command)} values, expected one more than the "
                    f"{len(getattr(self, name))} of {name}"
                )
        if not (math.isnan(self.travel_ratio) or 0.1 <= self.travel_ratio <= 10.0):
            raise ValueError(
                f"travel_ratio = {self.travel_ratio!r}: expected a number in [0.1, 10]"
            )
        if math.isinf(self.law_offset):
            raise ValueError(f"law_offset = {self.law_offset!r} rad: expected a finite number")
        self.model().steps(self.sample_period)

    def __str__(self) -> str:
        residual = f"{self.healthy_rms:.4f} A" if math.isfinite(self.healthy_rms) else "unknown"
        lift = f"lift {self.unit.lift:.4f} A, " if self.form == "fast" else ""
        return (
            f"calibration {self.calibration_id} of {self.actuator_id} from "
            f"{counted(self.windows, 'window')}, {lift}friction "
            f"{1.0 + self.unit.friction:.3f} and inertia {1.0 + self.unit.inertia:.3f} of nominal, "
            f"residual of a healthy window {residual}{self._remark}"
        )

    @cached_property
    def not_learned(self) -> tuple[str, ...]:
        """Names of the deviations that the healthy windows did not determine.

        The fit hardly reduced their standard deviations below the values in their priors.
        """
        if not np.any(self.unit_covariance):
            return ()  # no deviations were fitted
        travel = float(np.ptp(self.command))
        sigma = dict(zip(NAMES, np.sqrt(np.diag(self.unit_covariance)), strict=True))
        return tuple(
            prior.name
            for prior in unit_priors(self.parameters, travel or 1.0, self.form)
            # The prior of the load stiffness depends on the travel, which needs a command.
            if sigma[prior.name] > _LEARNED * prior.sigma
            and (travel or prior.name != "load_stiffness")
            and prior.column not in self.acquisition.missing
        )

    @property
    def _remark(self) -> str:
        remark = super()._remark
        if abs(self.travel_ratio - 1.0) > _SAME_SCALE:
            remark += (
                f"; the position travels {self.travel_ratio:.3g} times the integral of the speed: "
                f"check the sample period ({self.sample_period:g} s), the gear ratio and the "
                "scales of position and speed"
            )
        return remark

    @property
    def drive(self) -> str:
        """Kind of drive described by the model form."""
        return next(drive for drive, forms in FORMS_OF_DRIVES.items() if self.form in forms)

    @property
    def residual_text(self) -> str:
        """Formatted residuals of current and speed in a healthy window."""
        return f"{self.healthy_rms:.4g} A, {self.healthy_speed_rms:.4g} rad/s"

    def model(self) -> MonitorModel:
        """Return the monitor model of this unit."""
        return MonitorModel(self.parameters, self.form, self.dt, self.unit, self.acquisition)

    def of_any_motion(self) -> "Calibration":
        """Return the part of the calibration that is valid under any command.

        It lacks the correction of the calibrated command.
        """
        empty = np.zeros(0)
        return replace(self, command=self.command[:1], correction=empty, speed_correction=empty)

    @property
    def unit_parameters(self) -> ActuatorParameters:
        """Parameters of the unit: nominal values changed by the fitted deviations."""
        factors = {
            "friction": ("f_sm", "f_su"),
            "inertia": ("J_m", "J_u"),
            "viscous_friction": ("C_m", "C_u"),
            "backlash": ("BLK",),
            "loop_gain": ("G_prop",),
            "speed_loop": ("GAP",),
        }
        nominal = self.parameters
        if self.drive == "field_oriented":
            nominal = FieldOrientedParameters().replace(nominal.as_mapping())
        return nominal.replace(
            {
                name: getattr(self.parameters, name) * (1.0 + getattr(self.unit, deviation))
                for deviation, names in factors.items()
                for name in names
            }
        )

    def expect(self, response: Response, window: Window) -> Response:
        """Return the response of the model plus the corrections for a window."""
        current, speed = self.reference(window).corrections
        return Response(response.current + current, response.speed + speed)

    def reference(self, window: Window) -> HealthyReference:
        """Return the expected residuals of the model in a healthy window.

        Aligning noisy commands takes a few milliseconds.
        """
        shift = shift_if_same(window.command, self.command, self.sample_period)
        if shift is None:
            zeros = Response(*np.zeros((2, len(window))))
            return HealthyReference(False, zeros, (self.model_rms, self.model_speed_rms))
        corrections = moved(self.correction, shift), moved(self.speed_correction, shift)
        return HealthyReference(
            True, Response(*corrections), (self.healthy_rms, self.healthy_speed_rms)
        )

    def unit_mismatch(self, description: ActuatorDescription) -> tuple[Difference, ...]:
        """Return the differences between a description and the calibrated unit; empty if none."""
        differences: list[Difference] = []
        if self.form not in FORMS_OF_DRIVES.get(description.drive, ()):
            differences.append(("drive", description.drive, self.drive))
        unused = _unused_by(self.form)
        used = [name for name in self.parameters.as_mapping() if name not in unused]
        differences += self._differences(description, used)
        if description.acquisition != self.acquisition:
            differences.append(("acquisition", str(description.acquisition), str(self.acquisition)))
        return tuple(differences)

    def shape_mismatch(self, window: Window) -> Reason | None:
        """Return why the samples of a window do not fit the calibration; None if they fit."""
        if mismatch := super().shape_mismatch(window):
            return mismatch
        return ColumnsContradict.of(self.acquisition, window.telemetry.missing)

    @classmethod
    @cache
    def builtin(cls) -> "Calibration":
        """Return the shipped calibration of the built-in actuator, for the chirp of the thesis."""
        return cls.load(Path(__file__).with_name("builtin_calibration.yaml"))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a calibration from a file written by ``save``.

        Raises
        ------
        ValueError
            If the file is not a calibration; the message names the file and the defect.
        OSError
            If the file cannot be read.
        """
        return cls.of_content(path, load_yaml(path, MOST_BYTES))

    @classmethod
    def _of_mapping(cls, content: dict[str, Any]) -> Self:
        values = content["parameters"]
        content["parameters"] = ActuatorParameters().replace(values)
        for name in content["parameters"].as_mapping():
            if name not in (*values, *_unused_by(content["form"]), "lead"):
                raise ValueError(f"parameter {name} is missing")
        for name in (*_ROWS, "unit_covariance"):
            content[name] = numbers(name, content[name])
        if not isinstance(content["unit"], dict):
            raise ValueError(f"unit = {content['unit']!r}: expected deviations by name")
        content["unit"] = Deviations(**content["unit"])
        content["acquisition"] = Acquisition(**content.get("acquisition", {}))
        if _IDENTIFIED_AS in content:
            content["baseline"] = content.pop(_IDENTIFIED_AS)
        if "baseline" in content:
            content["baseline"] = WindowBaseline.of_mapping(content["baseline"])
        return cls(**content)

    def _as_mapping(self, *, with_labels: bool) -> dict[str, Any]:
        content = {"format": self.FORMAT, **asdict(self)}
        del content["baseline"]
        baseline = self.baseline
        if with_labels and baseline.windows:
            content["baseline"] = baseline.as_mapping()
        elif baseline.healthy:
            healthy = replace(baseline, windows=baseline.healthy)
            content[_IDENTIFIED_AS] = healthy.as_mapping()
        for name in (*_ROWS, "unit_covariance"):
            content[name] = getattr(self, name).tolist()
        content["unit"] = self.unit._asdict()
        for name in _SCATTERS:
            content[name] = float(getattr(self, name))
        # The file omits defaults.
        for name in _unused_by(self.form):
            del content["parameters"][name]
        if self.acquisition == USUAL:
            del content["acquisition"]
        else:  # a modelled drive has a command, and its effort is a current
            del content["acquisition"]["command"], content["acquisition"]["effort_unit"]
        for name in ("travel_ratio", "law_offset"):
            if math.isnan(content[name]):
                del content[name]
        return content


def _unused_by(form: str) -> tuple[str, ...]:
    """Return the parameters that a form of the model does not use."""
    return () if form in FORMS_OF_DRIVES["field_oriented"] else ("omega_c",)
