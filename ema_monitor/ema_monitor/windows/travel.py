"""How far the user shaft travels for what the motor turns, by two sensors (M27)."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.parameters import ActuatorParameters
from ema_monitor.windows.window import Window

LEAST_SIGMA: Final = 3e-4
"""What the ratio of two healthy sensors is known to at best [-]."""

_SPACING_S = 1e-3
_SLOW: Final = 0.2
_TRIMMED: Final = 2
_FEWEST_RUNS: Final = 3


class TravelRatio(NamedTuple):
    """Travel of the user shaft over that of the motor shaft and the gear [-], and its sigma."""

    value: float
    sigma: float


def travel_ratio(window: Window, parameters: ActuatorParameters) -> TravelRatio | None:
    """Return the ratio of what the position sensor and what the speed sensor say of the travel.

    It is that of runs one way, in which motor and shaft touch, so that the play does not count; an
    offset of the speed is fitted.

    Parameters
    ----------
    window
        The window.
    parameters
        The actuator: its gear.

    Returns
    -------
    TravelRatio or None
        None where the window has too little motion, or the speed is not measured.
    """
    if not len(window.telemetry.speed):
        return None
    h, telemetry = window.sample_period, window.telemetry
    turned = np.concatenate(
        [[0.0], np.cumsum(h * (telemetry.speed[1:] + telemetry.speed[:-1]) / 2.0)]
    )
    every = max(1, round(_SPACING_S / h))
    travelled = telemetry.position[::every] / parameters.tau
    if len(travelled) < 2:
        return None
    runs = _runs(np.diff(travelled))
    if len(runs) < _FEWEST_RUNS:
        return None
    first, last = runs.T
    turns = turned[::every][last] - turned[::every][first]
    design = np.stack([turns, h * every * (last - first)], axis=1)
    excess = travelled[last] - travelled[first] - turns
    normal = design.T @ design
    if np.linalg.cond(normal) > 1e12:
        return None
    fitted = np.linalg.solve(normal, design.T @ excess)
    left = excess - design @ fitted
    variance = float(left @ left) / (len(runs) - 2)
    sigma = np.sqrt(variance * np.linalg.inv(normal)[0, 0])
    return TravelRatio(1.0 + float(fitted[0]), float(np.hypot(sigma, LEAST_SIGMA)))


def _runs(steps: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return first and last value of the runs one way, ``(k, 2)``, of steps, ``(n,)``."""
    way = np.sign(steps) * (np.abs(steps) > _SLOW * np.sqrt(np.mean(steps**2)))
    changes = np.flatnonzero(np.diff(way)) + 1
    begins, ends = np.concatenate([[0], changes]), np.concatenate([changes, [len(way)]])
    long = (way[begins] != 0.0) & (ends - begins > 2 * _TRIMMED)
    return np.stack([begins[long] + _TRIMMED, ends[long] - _TRIMMED], axis=1)
