"""Calibrating: from healthy windows of one unit to its calibration."""

import math
from collections.abc import Iterator, Sequence
from functools import reduce
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.faults import healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.alignment import difference_at, moved, shift_between
from ema_monitor.calibration.calibration import (
    COMMAND_TOLERANCE,
    LEAST_SCATTER,
    MOST_SCALE,
    Calibration,
    unit_model,
)
from ema_monitor.model.monitor_model import FORMS, MonitorModel, Response
from ema_monitor.windows.band import band_limited, rms, speed_weight
from ema_monitor.windows.window import Window

PRIOR_SIGMA: Final = 0.1
"""Prior standard deviation of friction and inertia from nominal [-]."""

_STEP = 0.02
_ITERATIONS = 6
_TOLERANCE = 1e-4


class Structure(NamedTuple):
    """Figures of a unit that change the model itself; see `Calibration`."""

    lift: float
    friction_scale: float
    inertia_scale: float


def calibrate(
    windows: Sequence[Window],
    description: ActuatorDescription | None = None,
    form: str = "fast",
    *,
    structural: bool = True,
) -> Calibration:
    """Calibrate the monitor model on healthy windows of one actuator.

    Parameters
    ----------
    windows
        Windows of the same command, at least one; ten or more average out the PWM's ripple. They
        are used one at a time, several times over, so that they may be read when needed.
    description
        The unit that the windows were taken from; the built-in actuator when None.
    form
        Form of the monitor model. The structural figures are fitted for the "fast" form only: the
        thesis's calibration, which goes with the "source" form, is the correction alone.
    structural
        Whether to fit the structural figures, where the form has them; else the correction is all.

    Raises
    ------
    ValueError
        When there is no window, or one is not like the first.
    """
    description = description or ActuatorDescription()
    if not windows:
        raise ValueError("calibration needs at least one healthy window, got none")
    first = windows[0]
    h = first.sample_period
    for number, window in enumerate(windows):
        if reason := window.excitation_defect() or _unlike(window, first):
            raise ValueError(f"window {number}: {reason}")
    # The longest step up to the form's own that divides the sample period.
    dt = h / math.ceil(h / FORMS[form] - 1e-6)
    parameters = description.parameters
    structure = Structure(0.0, 1.0, 1.0)
    if structural and form == "fast":
        structure = _fit_structure(windows, parameters, dt)
    model = unit_model(parameters, form, dt, *structure)
    correction, speed_correction = mean = _mean_missed(windows, model)
    healthy_rms, healthy_speed_rms = _scatter(windows, model, mean, h)
    return Calibration(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        parameters=parameters,
        form=form,
        dt=dt,
        sample_period=h,
        command=first.command,
        lift=structure.lift,
        friction_scale=structure.friction_scale,
        inertia_scale=structure.inertia_scale,
        correction=correction,
        speed_correction=speed_correction,
        healthy_rms=healthy_rms,
        healthy_speed_rms=healthy_speed_rms,
        windows=len(windows),
    )


def _missed(windows: Sequence[Window], model: MonitorModel) -> Iterator[NDArray[np.float64]]:
    """Yield what a healthy model misses of current and speed, ``(2, n)`` [A, rad/s] a window.

    All windows are laid over the first.
    """
    command = windows[0].command
    for window in windows:
        response = _healthy_response(window, model)
        shift = shift_between(window.command, command)
        measured = (window.current, window.telemetry.speed[1:])
        yield np.array(
            [moved(row - one[0], -shift) for row, one in zip(measured, response, strict=True)]
        )


def _mean_missed(windows: Sequence[Window], model: MonitorModel) -> NDArray[np.float64]:
    """Return the mean over windows of what a healthy model misses, ``(2, n)``."""
    return reduce(np.add, _missed(windows, model)) / len(windows)


def _healthy_response(window: Window, model: MonitorModel) -> Response:
    return model.respond(window, healthy_faults(), 0.0 if window.play is None else window.play)


def _fit_structure(
    windows: Sequence[Window], parameters: ActuatorParameters, dt: float
) -> Structure:
    """Fit the structural figures to the mean of healthy windows.

    Gauss-Newton on current and speed in their band. Of torque constant, friction and inertia only
    the ratios show in a window; the torque constant is kept, and the others are held near nominal
    by a prior, which only matters for parameters that the windows do not determine.
    """
    h = windows[0].sample_period
    stiffness = speed_weight(parameters)
    # The ripple of the idle phase fills the hysteresis band, its mean magnitude is half of that,
    # and the equivalent current counts the half of it.
    lift = parameters.h_b / 4.0
    x = np.array([lift, 1.0, 1.0])
    sigma = np.array([lift, PRIOR_SIGMA, PRIOR_SIGMA])
    for _ in range(_ITERATIONS):
        missed = _mean_missed(windows, unit_model(parameters, "fast", dt, *x))
        residual = _in_band(missed, stiffness, h)
        columns = []
        for step in _STEP * np.eye(3):
            sides = [
                _healthy_response(windows[0], unit_model(parameters, "fast", dt, *(x + side)))
                for side in (step, -step)
            ]
            above, below = (np.array([one.current[0], one.speed[0]]) for one in sides)
            columns.append(_in_band((above - below) / (2.0 * _STEP), stiffness, h))
        jacobian = np.array(columns).T
        # The residual that is left, at least a hundredth of an ampere, sets what a value weighs.
        noise = max(rms(residual), 1e-2)
        normal = jacobian.T @ jacobian / noise**2 + np.diag(1.0 / sigma**2)
        slope = jacobian.T @ residual / noise**2 - (x - [lift, 1.0, 1.0]) / sigma**2
        move = np.linalg.solve(normal, slope)
        x = np.clip(
            x + move,
            [-4.0 * lift, 1.0 / MOST_SCALE, 1.0 / MOST_SCALE],
            [4.0 * lift, MOST_SCALE, MOST_SCALE],
        )
        if np.max(np.abs(move)) < _TOLERANCE:
            break
    return Structure(*map(float, x))


def _in_band(rows: NDArray[np.float64], stiffness: float, h: float) -> NDArray[np.float64]:
    """Return current and speed, ``(2, n)``, in their band as one row [A]."""
    current, speed = band_limited(rows, h)
    return np.concatenate([current, stiffness * speed])


def _scatter(
    windows: Sequence[Window], model: MonitorModel, mean: NDArray[np.float64], h: float
) -> tuple[float, float]:
    """Return the rms in current and speed that another window has in its band after correction."""
    m = len(windows)
    if m == 1:
        return float("nan"), float("nan")
    band = np.array([band_limited(missed - mean, h) for missed in _missed(windows, model)])
    # Each window is itself in the mean that it is compared with; another one will not be.
    scale = math.sqrt((m + 1.0) / (m - 1.0))
    current, speed = (rms(band[:, column]) * scale for column in (0, 1))
    return (
        current if current > LEAST_SCATTER else float("nan"),
        speed if speed > LEAST_SCATTER else float("nan"),
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
    limit = COMMAND_TOLERANCE * rms(first.command)
    if difference > limit:
        return (
            f"it has another command than the first: {difference:.3g} rad rms apart (limit "
            f"{limit:.3g} rad)"
        )
    return ""
