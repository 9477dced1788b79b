# SPDX-License-Identifier: Apache-2.0
"""Relations between the sensors in a window: travel ratio and control law (M27)."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array
from ema_core.parameters import ActuatorParameters, constants
from ema_monitor.windows.band import band_limited
from ema_monitor.windows.window import Window

LEAST_SIGMA: Final = 3e-4
"""Smallest standard deviation of the ratio between two healthy sensors [-]."""

_SPACING_S: Final = 1e-3
_SLOW: Final = 0.2
_TRIMMED: Final = 2
_FEWEST_RUNS: Final = 3
_LEAST_SHARE: Final = 0.15
_FAR_FROM_LIMITS: Final = 0.8
_FEWEST: Final = 20


class Relation(NamedTuple):
    """Measured relation between two sensors, with its standard deviation."""

    value: float
    sigma: float


def travel_ratio(window: Window, parameters: ActuatorParameters) -> Relation | None:
    """Return the ratio of user-shaft travel to geared motor travel [-].

    The travels come from the position and speed sensors during runs in one direction, in which play
    has no effect. An offset of the speed is fitted as well. The result is None if the motion does
    not determine the ratio, or the speed is not measured.
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
    residuals = excess - design @ fitted
    variance = float(residuals @ residuals) / (len(runs) - 2)
    sigma = np.sqrt(variance * np.linalg.inv(normal)[0, 0])
    return Relation(1.0 + float(fitted[0]), float(np.hypot(sigma, LEAST_SIGMA)))


def law_offset(window: Window, parameters: ActuatorParameters) -> Relation | None:
    """Return the offset of the position from the drive's control law [rad].

    A drive with a proportional speed loop follows ``command - position = (k_t I / GAP + omega) /
    G_prop`` (M1) under any friction and load. The offset is fitted together with the gain of the
    loop, a delay of the command and a gain of the position. Its standard deviation is at least 15 %
    of the friction band: if the gains of the drive differ from the description, a load can look
    like an offset of this size. The result is None if the drive has a different control law, a
    column is not measured, too few samples are within the limits of the drive, or the motion does
    not determine the offset.
    """
    if parameters.GAI != 0.0 or parameters.GAD != 0.0 or window.telemetry.missing:
        return None
    telemetry, h = window.telemetry, window.sample_period
    rows = np.stack([telemetry.command, telemetry.position, telemetry.current, telemetry.speed])
    command, position, current, speed = band_limited(rows[:, 1:], h)
    torque = parameters.k_t * current
    lead = (torque / parameters.GAP + speed) / parameters.G_prop
    within = np.abs(current) < _FAR_FROM_LIMITS * parameters.I_max
    within &= np.abs(lead) < _FAR_FROM_LIMITS * parameters.omega_max / parameters.G_prop
    if np.sum(within) < _FEWEST:
        return None
    design = np.stack([np.ones_like(lead), lead, np.gradient(command), command])[:, within]
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
    return Relation(float(fitted[0]), float(np.hypot(sigma, _LEAST_SHARE * held)))


def _runs(steps: Array) -> NDArray[np.int64]:
    """Return the indices of the first and last value of each run in one direction, ``(k, 2)``."""
    direction = np.sign(steps) * (np.abs(steps) > _SLOW * np.sqrt(np.mean(steps**2)))
    changes = np.flatnonzero(np.diff(direction)) + 1
    begins, ends = np.concatenate([[0], changes]), np.concatenate([changes, [len(direction)]])
    long = (direction[begins] != 0.0) & (ends - begins > 2 * _TRIMMED)
    return np.stack([begins[long] + _TRIMMED, ends[long] - _TRIMMED], axis=1)
