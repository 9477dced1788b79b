"""Calibration of a unit whose drive is unknown: its healthy current balance (M44)."""

import math
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Final, Self

import numpy as np

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.linear import motor_shown
from ema_core.parameters import ActuatorParameters
from ema_core.wording import counted
from ema_monitor.calibration.stored import StoredCalibration, numbers
from ema_monitor.current_balance.balance import number_of_terms
from ema_monitor.normal.unit_normal import UnitNormal

LEARNED: Final = 0.08
"""Relative standard deviation up to which the torque per ampere counts as known [-]."""

_USED: Final = ("tau", "P", "BLK")
_POSITIVE: Final = ("sample_period", "knee", "noise", "fastest")


@dataclass(frozen=True, eq=False)
class UnknownDriveUnit(StoredCalibration):
    """What a healthy unit with an unknown drive is like.

    All torques are relative to the torque per ampere: in amperes of the current that they take.

    Attributes
    ----------
    actuator_id, serial_number
        The unit it was made on.
    parameters
        Those described; gear ratio, pole pairs and nominal play are used, and the torque constant
        to say amperes in N.m.
    sample_period
        Period of the telemetry [s].
    speed_measured
        Whether the speed was measured.
    windows
        Number of healthy windows.
    terms, covariance
        The terms of the current balance, ``(terms,)``, and their covariance.
    load, stiffness
        Mean load [A] and stiffness [A/rad]; later loads count from there.
    knee
        Current from which on the part that makes no torque is constant [A].
    noise
        Rms of what the balance misses of a healthy motion [A].
    play, play_sigma
        Free play and its standard deviation [rad, at the motor]; NaN where the motion did not show
        it.
    fastest
        Largest speed of the motor in the windows [rad/s].
    normal
        Figures of the windows, which show what departs; empty when they were not taken.
    """

    FORMAT: ClassVar = "unknown_drive_1"

    form = "unknown_drive"
    """There are no kernels to compile for it."""

    unit_parameters = None
    """Nothing of the unit is known in the units of parameters."""

    actuator_id: str
    serial_number: str
    parameters: ActuatorParameters
    sample_period: float
    speed_measured: bool
    windows: int
    terms: Array = field(repr=False)
    covariance: Array = field(repr=False)
    load: float
    stiffness: float
    knee: float
    noise: float
    play: float
    play_sigma: float
    fastest: float
    normal: UnitNormal = field(default=UnitNormal(), repr=False)

    def __post_init__(self) -> None:
        size = number_of_terms(self.parameters.P)
        for name, shape in (("terms", (size,)), ("covariance", (size, size))):
            found = getattr(self, name)
            if found.shape != shape or not np.all(np.isfinite(found)):
                raise ValueError(f"{name} is not an array of {shape} finite numbers")
        for name in _POSITIVE:
            value = getattr(self, name)
            if not isinstance(value, float | int) or not 0.0 < value < math.inf:
                raise ValueError(f"{name} = {value!r}: expected a positive number")
        for number, name in enumerate(("inertia", "friction")):
            if not self.terms[number] > 0.0:
                raise ValueError(
                    f"{name} over the torque per ampere is {self.terms[number]:.4g}: expected a "
                    "positive number; does the current have the sign of the motion?"
                )

    def __str__(self) -> str:
        J, f = self.terms[:2]
        play = "play not shown"
        if math.isfinite(self.play):
            unit, scale = motor_shown(self.parameters)
            play = f"play {scale * self.play:.4g} ± {scale * self.play_sigma:.2g} {unit}"
        return (
            f"calibration {self.calibration_id} of {self.actuator_id} (drive unknown) from "
            f"{counted(self.windows, 'window')}, relative to the torque per ampere: inertia "
            f"{J:.4g} A.s^2/rad, friction {f:.4g} A, {play}, residual of a healthy motion "
            f"{self.noise:.4f} A{self._remark}"
        )

    @property
    def not_learned(self) -> tuple[str, ...]:
        """Names of what the healthy windows did not show."""
        is_missing = {
            "torque_per_ampere": math.sqrt(self.covariance[0, 0]) > LEARNED * self.terms[0],
            "friction": self.friction_sigma > 0.1 * self.terms[1],
            "backlash": math.isnan(self.play),
        }
        return tuple(name for name, missing in is_missing.items() if missing)

    @cached_property
    def friction_pull(self) -> float:
        """How friction follows the current that makes no torque, for all that is known [-]."""
        variance = self.covariance[3, 3]
        return float(self.covariance[1, 3] / variance) if variance > 0.0 else 0.0

    @cached_property
    def friction_sigma(self) -> float:
        """Standard deviation of friction, were the current known that makes no torque [A]."""
        rest = self.covariance[1, 1] - self.friction_pull**2 * self.covariance[3, 3]
        return math.sqrt(max(float(rest), 0.0))

    @property
    def residual_in_words(self) -> str:
        """Residual of the current balance of a healthy motion."""
        return f"{self.noise:.4g} A"

    def of_any_motion(self) -> Self:
        """Return what holds under any command, which is all."""
        return self

    def unit_mismatch(self, description: ActuatorDescription) -> str:
        """Return why this calibration does not fit a described actuator; empty when it does."""
        reasons = []
        if description.drive != "unknown":
            reasons.append(
                f"the actuator has drive = {description.drive}, the calibration is of a drive "
                "whose controller is unknown"
            )
        if description.acquisition.speed != self.speed_measured:
            reasons.append(
                "the speed is measured in one of both, telemetry and calibration, and not in the "
                "other"
            )
        return "; ".join(reasons + self._mismatches(description, _USED))

    def _as_mapping(self) -> dict[str, Any]:
        content = {"format": self.FORMAT, **asdict(self)}
        for name in ("terms", "covariance"):
            content[name] = content[name].tolist()
        return content

    @classmethod
    def _of_mapping(cls, content: dict[str, Any]) -> Self:
        content["parameters"] = ActuatorParameters().replace(content["parameters"])
        for name in ("terms", "covariance"):
            content[name] = numbers(name, content[name])
        return cls(**content)
