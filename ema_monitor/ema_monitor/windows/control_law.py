"""Whether the position is the one that the control law of the drive sees (M27)."""

from typing import NamedTuple

import numpy as np

from ema_core.parameters import ActuatorParameters, constants
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.window import Window

_LEAST_SHARE = 0.15
_FAR_FROM_LIMITS = 0.8
_FEWEST = 20


class LawOffset(NamedTuple):
    """By how much the position is too high for the control law, and its sigma [rad]."""

    value: float
    sigma: float


def law_offset(window: Window, parameters: ActuatorParameters) -> LawOffset | None:
    """Return by how much the position is too high for what the drive makes of it.

    A speed loop in proportion has ``command - position = (k_t I / GAP + omega) / G_prop`` (M1),
    whatever friction and load are. The offset is fitted with the gain of the loop, a delay of the
    command and a gain of the position.

    Parameters
    ----------
    window
        The window.
    parameters
        The actuator. At best, the offset is known to 0.15 of what its friction holds: where the
        drive's gains are not as described, a load is at times taken for as much.

    Returns
    -------
    LawOffset or None
        None where the drive has another law, too little of the window is within its limits, or
        current or speed is not measured.
    """
    if parameters.GAI != 0.0 or parameters.GAD != 0.0 or window.telemetry.missing:
        return None
    telemetry, h = window.telemetry, window.sample_period
    rows = np.stack([telemetry.command, telemetry.position, telemetry.current, telemetry.speed])
    command, position, current, speed = band_limited(rows[:, 1:], h)
    torque = parameters.k_t * current
    wanted = (torque / parameters.GAP + speed) / parameters.G_prop
    within = np.abs(current) < _FAR_FROM_LIMITS * parameters.I_max
    within &= np.abs(wanted) < _FAR_FROM_LIMITS * parameters.omega_max / parameters.G_prop
    if np.sum(within) < _FEWEST:
        return None
    design = np.stack([np.ones_like(wanted), wanted, np.gradient(command), command])[:, within]
    scale = np.sqrt(np.mean(design**2, axis=1))
    if np.any(scale == 0.0):
        return None
    design = (design / scale[:, None]).T
    lag = (position - command)[within]
    normal = design.T @ design
    if np.linalg.cond(normal) > 1e10:
        return None
    fitted = np.linalg.solve(normal, design.T @ lag)
    variance = float(np.mean((lag - design @ fitted) ** 2))
    sigma = np.sqrt(variance * np.linalg.inv(normal)[0, 0])
    held = float(constants(parameters).mechanics.f_s) / (parameters.GAP * parameters.G_prop)
    return LawOffset(float(fitted[0]), float(np.hypot(sigma, _LEAST_SHARE * held)))
