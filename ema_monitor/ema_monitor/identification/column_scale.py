# SPDX-License-Identifier: Apache-2.0
"""Relations between the columns of a window that reveal a wrong factor, such as a unit or sign.

The position follows its command, the speed is the derivative of the position, and the current
accelerates the known inertia. No fault scales these relations. `ema_core.columns.of_window` decides
which column is wrong.
"""

from collections.abc import Iterable
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.causes import CauseEstimate
from ema_core.columns.errors import ColumnError
from ema_core.columns.of_window import WindowRelations, wrong_amplitude, wrong_column_of_window
from ema_core.parameters import ActuatorParameters
from ema_monitor.windows.window import Window

_SMOOTH_S: Final = 4e-3
_KNEE: Final = 5.0
_SURE: Final = 0.03
_ALIKE: Final = 0.7


def mistaken_amplitude(causes: Iterable[CauseEstimate]) -> ColumnError | None:
    """Return the error of a current recorded as RMS instead of peak or vice versa, or None.

    The error shows in the current gain among the hidden causes.
    """
    for cause in causes:
        if cause.name == "current_gain" and (error := wrong_amplitude(1.0 + cause.value)):
            return error
    return None


def wrong_scale(window: Window, parameters: ActuatorParameters) -> ColumnError | None:
    """Return the error of a column in a window that is certainly wrong by a factor, or None."""
    tau = parameters.tau
    t, h = window.telemetry, window.sample_period
    count = max(3, round(_SMOOTH_S / h))
    if t.missing or len(t) < 4 * count:
        return None
    kernel = np.full(count, 1.0 / count)
    command, position, speed, current = (
        np.convolve(column, kernel, "valid")
        for column in (t.command, t.position, t.speed, t.current)
    )
    # Ratio of the measured speed to the derivative of the position.
    speed_ratio = _slope(np.gradient(position, h) / tau, speed)
    tracking = _slope(command - command.mean(), position - position.mean())
    if speed_ratio is None or tracking is None:
        return None
    inertia = (parameters.J_m + parameters.J_u) / parameters.k_t
    apparent = _inertia_of(speed, current, position, h)
    relations = WindowRelations(
        speed_ratio, tracking, None if apparent is None else apparent / inertia
    )
    return wrong_column_of_window(relations, tau)


def _slope(x: Array, y: Array) -> float | None:
    """Return the ratio of ``y`` to ``x`` by regression, or None if they are not proportional."""
    xx, xy, yy = float(x @ x), float(x @ y), float(y @ y)
    return xy / xx if xy**2 > _ALIKE * xx * yy > 0.0 else None


def _inertia_of(speed: Array, current: Array, position: Array, h: float) -> float | None:
    """Return the ratio of current to acceleration [A.s^2/rad], or None if it is too uncertain."""
    rows = np.stack(
        [np.gradient(speed, h), speed, np.tanh(speed / _KNEE), position, np.ones_like(speed)], 1
    )
    scale = np.maximum(np.abs(rows).max(axis=0), 1e-300)
    rows = rows / scale
    coefficients, *_ = np.linalg.lstsq(rows, current, rcond=None)
    residuals = current - rows @ coefficients
    # Neighbouring samples are correlated: about one in ten is independent.
    variance = 10.0 * float(residuals @ residuals) / max(len(residuals) - rows.shape[1], 1)
    covariance = variance * np.linalg.pinv(rows.T @ rows)
    if np.sqrt(covariance[0, 0]) > _SURE * abs(coefficients[0]):
        return None
    return float(coefficients[0] / scale[0])
