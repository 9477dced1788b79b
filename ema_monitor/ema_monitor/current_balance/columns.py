"""Columns of telemetry as the current balance reads them, however they were acquired (M40)."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry

_SPAN_S: Final = 2e-3
_SPAN_WITHOUT_SPEED_S: Final = 3e-3


@dataclass(frozen=True, eq=False)
class MotorMotion:
    """Motion of the motor between samples, ``n`` of them, and the steps between, ``n - 1``.

    Attributes
    ----------
    step_s
        Time between samples [s].
    span
        Steps over which a row of the balance averages.
    current
        Mean current of each step, ``(n - 1,)`` [A].
    turned
        Angle of the motor, ``(n,)`` [rad]: the integral of the speed where that is measured, else
        that of the shaft behind the play over the gear.
    speed
        Speed of the motor at the samples, ``(n,)`` [rad/s]; None where it is not measured.
    shaft
        Position of the user shaft over the gear, ``(n,)`` [rad].
    error
        Command less position, ``(n,)`` [rad].
    """

    step_s: float
    span: int
    current: NDArray[np.float64]
    turned: NDArray[np.float64]
    speed: NDArray[np.float64] | None
    shaft: NDArray[np.float64]
    error: NDArray[np.float64]

    @classmethod
    def of(cls, telemetry: Telemetry, description: ActuatorDescription) -> Self:
        """Return those of telemetry, as its description says that it was acquired.

        A mean is that of its step. Behind a filter of the time constant T the mean current is
        ``(I_1 + I_2) / 2 + T (I_2 - I_1) / h``, exactly so for a current that changes evenly; a
        value at an instant is taken to do so.
        """
        h, acquisition = telemetry.sample_period, description.acquisition
        current, tau = telemetry.current, description.parameters.tau
        if acquisition.current == "mean":
            of_steps = current[1:]
        else:
            of_steps = (current[1:] + current[:-1]) / 2.0
            of_steps = of_steps + acquisition.current_filter / h * np.diff(current)
        shaft, error = telemetry.position / tau, telemetry.command - telemetry.position
        if has_speed(telemetry, description):
            speed = telemetry.speed
            span = max(1, round(_SPAN_S / h))
            return cls(h, span, of_steps, _integral(speed, h), speed, shaft, error)
        span = max(1, round(_SPAN_WITHOUT_SPEED_S / h))
        return cls(h, span, of_steps, shaft, None, shaft, error)


def has_speed(telemetry: Telemetry, description: ActuatorDescription) -> bool:
    """Return whether the speed is measured: the description says so, and the column is filled."""
    speed = telemetry.speed
    return description.acquisition.speed and bool(len(speed)) and bool(np.all(np.isfinite(speed)))


def _integral(speed: NDArray[np.float64], h: float) -> NDArray[np.float64]:
    """Return the integral of a speed from 0, ``(n,)``: trapezia, corrected for its curvature."""
    if len(speed) < 3:
        return np.concatenate([[0.0], np.cumsum(h * (speed[1:] + speed[:-1]) / 2.0)])
    trapezia = np.concatenate([[0.0], np.cumsum(h * (speed[1:] + speed[:-1]) / 2.0)])
    slope = np.gradient(speed)
    return trapezia - h / 12.0 * (slope - slope[0])
