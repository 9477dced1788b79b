"""Calibration of a unit whose drive is unknown: its healthy current balance, and its file (M44)."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.wording import counted
from ema_monitor.calibration.files import identity_of, write_calibration
from ema_monitor.current_balance.terms import BASIC, columns_of, ripples
from ema_monitor.windows.window import Window

FORMAT: Final = "unknown_drive_1"
"""Of the file."""

LEARNED: Final = 0.08
"""Relative standard deviation up to which the torque per ampere counts as known [-]."""

_USED: Final = ("tau", "P", "BLK")
_POSITIVE: Final = ("sample_period", "knee", "noise", "fastest")


@dataclass(frozen=True, eq=False)
class UnknownDriveUnit:
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

    Raises
    ------
    ValueError
        When a figure is impossible; the message names it.
    """

    actuator_id: str
    serial_number: str
    parameters: ActuatorParameters
    sample_period: float
    speed_measured: bool
    windows: int
    terms: NDArray[np.float64] = field(repr=False)
    covariance: NDArray[np.float64] = field(repr=False)
    load: float
    stiffness: float
    knee: float
    noise: float
    play: float
    play_sigma: float
    fastest: float

    form = "unknown_drive"
    """There are no kernels to compile for it."""

    def __post_init__(self) -> None:
        groups = ripples(self.parameters.P)
        size = len(BASIC) + sum(2 * len(group.orders) for group in groups)
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
                    "positive number; is the sign of the current that of the motion?"
                )

    @cached_property
    def calibration_id(self) -> str:
        """Identity of the content: the same figures give the same name."""
        return identity_of(self.serial_number, self._as_mapping())

    def __str__(self) -> str:
        J, f = self.terms[:2]
        play = (
            f"play {self.play:.4g} ± {self.play_sigma:.2g} rad"
            if math.isfinite(self.play)
            else "play not shown"
        )
        words = ", ".join(name.replace("_", " ") for name in self.not_learned)
        return (
            f"calibration {self.calibration_id} of {self.actuator_id} (drive unknown) from "
            f"{counted(self.windows, 'window')}, relative to the torque per ampere: inertia "
            f"{J:.4g} A.s^2/rad, friction {f:.4g} A, {play}, residual of a healthy motion "
            f"{self.noise:.4f} A" + (f"; not learned from these windows: {words}" if words else "")
        )

    @cached_property
    def not_learned(self) -> tuple[str, ...]:
        """Names of what the healthy windows did not show."""
        names = []
        sigma = np.sqrt(np.diag(self.covariance))
        if sigma[0] > LEARNED * self.terms[0]:
            names.append("torque_per_ampere")
        if self.friction_sigma > 0.1 * self.terms[1]:
            names.append("friction")
        if math.isnan(self.play):
            names.append("backlash")
        return tuple(names)

    @property
    def unit_parameters(self) -> None:
        """Nothing of the unit is known in the units of parameters."""
        return

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

    def ripple(self, name: str) -> slice:
        """Return where the terms of a ripple are."""
        return columns_of(ripples(self.parameters.P))[name]

    def unit_mismatch(self, description: ActuatorDescription) -> str:
        """Return why this calibration does not fit a described actuator; empty when it does."""
        reasons = []
        if description.drive != "unknown":
            reasons.append(
                f"the actuator has drive = {description.drive}, the calibration is of a drive "
                "whose controller is unknown"
            )
        if description.serial_number != self.serial_number:
            reasons.append(
                f"the actuator has serial number {description.serial_number!r}, the calibration "
                f"was made on {self.serial_number!r}"
            )
        if description.acquisition.speed != self.speed_measured:
            reasons.append(
                "the speed is measured in one of both, telemetry and calibration, and not in the "
                "other"
            )
        mine, theirs = self.parameters.as_mapping(), description.parameters.as_mapping()
        reasons += [
            f"the actuator has {name} = {theirs[name]:g}, the calibration {mine[name]:g}"
            for name in _USED
            if not np.isclose(mine[name], theirs[name], rtol=1e-9, atol=0.0)
        ]
        return "; ".join(reasons)

    def shape_mismatch(self, window: Window) -> str:
        """Return why the samples of a window are not those calibrated; empty when they are."""
        if abs(window.sample_period / self.sample_period - 1.0) > 1e-6:
            return (
                f"the sample period is {window.sample_period:g} s, the calibration's "
                f"{self.sample_period:g} s"
            )
        return ""

    def save(self, path: Path) -> None:
        """Write the calibration to a YAML file; an existing one is replaced once it is complete."""
        write_calibration(path, self._as_mapping(), self.calibration_id)

    @classmethod
    def of_mapping(cls, content: Mapping[str, Any]) -> Self:
        """Return the calibration that the entries of a file describe, as `built_of` gives them.

        Raises
        ------
        ValueError, KeyError, TypeError
            When it describes none.
        """
        values = {
            name: value
            for name, value in content.items()
            if name not in ("format", "calibration_id")
        }
        values["parameters"] = ActuatorParameters().replace(values["parameters"])
        for name in ("terms", "covariance"):
            values[name] = np.array(values[name], dtype=np.float64)
        return cls(**values)

    def _as_mapping(self) -> dict[str, Any]:
        content = {"format": FORMAT, **asdict(self)}
        content["parameters"] = self.parameters.as_mapping()
        for name in ("terms", "covariance"):
            content[name] = getattr(self, name).tolist()
        return content
