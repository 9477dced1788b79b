"""What was measured in a window beside what the model expects, thinned for display."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.model.deviations import N_DEVIATIONS, NAMES
from ema_monitor.windows.window import Window

MOST_VALUES: Final = 500
"""Largest number of values of a thinned signal."""


@dataclass(frozen=True, eq=False)
class WindowFit:
    """Signals of a window, each value the mean over a period, ``(m,)`` each.

    Attributes
    ----------
    period
        Time from one value to the next [s].
    start
        Time of the first value, the middle of its period, after the window's first sample [s].
    command, position
        Commanded and measured user angle [rad].
    current, estimated_current
        Measured equivalent current and that of the model at the estimate [A].
    speed, estimated_speed
        Measured motor speed and that of the model at the estimate [rad/s].
    """

    period: float
    start: float
    command: NDArray[np.float64]
    position: NDArray[np.float64]
    current: NDArray[np.float64]
    estimated_current: NDArray[np.float64]
    speed: NDArray[np.float64]
    estimated_speed: NDArray[np.float64]


def window_fit(window: Window, estimate: Estimate, calibration: Calibration) -> WindowFit:
    """Return a window beside the response of the calibrated model at its estimate.

    Parameters
    ----------
    window
        The window.
    estimate
        The estimate in it; the model's signals are NaN where it has no faults, as of a refusal.
    calibration
        Calibration that it was made with.

    Raises
    ------
    ValueError
        When the sample period is no multiple of the model's step, so that no fit was possible.
    """
    expected = np.full((2, len(window)), np.nan)
    if np.isfinite(estimate.faults).all():
        deviations = np.zeros((1, N_DEVIATIONS))
        for one in (*estimate.measured, *estimate.causes):
            deviations[0, NAMES.index(one.name)] = one.value
        faults = np.array([estimate.faults])
        model = calibration.model()
        response = model.respond(window, faults, estimate.play, deviations=deviations)
        expected = np.concatenate(calibration.expect(response, window))
    recorded = window.telemetry
    rows = np.stack(
        [
            recorded.command[1:],
            recorded.position[1:],
            window.current,
            expected[0],
            recorded.speed[1:],
            expected[1],
        ]
    )
    each = -(-len(window) // MOST_VALUES)
    whole = len(window) // each * each
    command, position, current, estimated_current, speed, estimated_speed = (
        rows[:, :whole].reshape(len(rows), -1, each).mean(axis=2)
    )
    h = window.sample_period
    return WindowFit(
        period=each * h,
        start=0.5 * (each + 1) * h,
        command=command,
        position=position,
        current=current,
        estimated_current=estimated_current,
        speed=speed,
        estimated_speed=estimated_speed,
    )
