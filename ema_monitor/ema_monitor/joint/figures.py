# SPDX-License-Identifier: Apache-2.0
"""Model-free figures of a record: scatter and roughness by direction, lag, lost motion."""

import math
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.joint.parts import DIRECTIONS, log_rms, steps_within
from ema_monitor.joint.signals import Fine, Preparation, Signals, user_speed
from ema_monitor.joint.smoothing import smoothed


class Figure(NamedTuple):
    """A model-free figure."""

    label: str
    """Displayed name."""
    repeated: float
    """Prior median of the standard deviation of the logarithm between days, for repeated motion
    [-]."""
    varied: float | None
    """Prior median for varied motion [-]; None if the figure is compared for repeated motion only.
    """


FIGURES: Final = {
    "effort_scatter": Figure("scatter of the effort", 0.05, 0.1),
    "effort_roughness": Figure("roughness of the effort", 0.014, 0.08),
    "error_scatter": Figure("scatter of the tracking error", 0.02, None),
    "error_roughness": Figure("roughness of the tracking error", 0.014, None),
}
"""Compared figures by name. Their values are logarithms, averaged over both directions."""

OF_EFFORT: Final = ("effort_scatter", "effort_roughness")
"""Figures that grow with the effort."""

SPEED_STEPS: Final = "speed_steps"
"""Name of the roughness of the speed, which is not compared itself.

It shows whether two motions accelerate similarly: acceleration makes the effort rougher.
"""

_FEWEST: Final = 20
_TINY: Final = 1e-12
_SETTLE_SHARE: Final = 0.7
_FEWEST_TURNS: Final = 4


def figures_of(
    telemetry: Telemetry, signals: Signals, residuals: Array, preparation: Preparation
) -> dict[str, float]:
    """Return the model-free figures of a record by name, without figures it does not determine.

    Figures of a single direction have the direction in their name.

    Parameters
    ----------
    telemetry
        Samples of the record.
    signals, residuals
        Rows of steady motion, and the residuals of their effort, ``(n,)`` [A].
    preparation
        Preparation of the record.
    """
    figures: dict[str, float] = {}
    speed = np.gradient(smoothed(telemetry.position, 2.0), telemetry.sample_period)
    fast = _SETTLE_SHARE * preparation.usual_speed
    for direction, sign in DIRECTIONS.items():
        rows = np.sign(signals.direction) == sign
        moving = sign * speed > fast
        if len(telemetry.interpolated):
            moving &= ~telemetry.interpolated
        if np.sum(rows) >= _FEWEST:
            figures[f"effort_scatter_{direction}"] = log_rms(residuals[rows])
        if np.sum(moving) >= _FEWEST:
            figures[f"effort_roughness_{direction}"] = log_rms(
                steps_within(telemetry.current, moving)
            )
            figures[f"{SPEED_STEPS}_{direction}"] = log_rms(steps_within(speed, moving))
            if telemetry.has_command:
                error = telemetry.command - telemetry.position
                chosen = error[moving]
                figures[f"error_scatter_{direction}"] = log_rms(chosen - np.mean(chosen))
                figures[f"error_roughness_{direction}"] = log_rms(steps_within(error, moving))
    for name in (*FIGURES, SPEED_STEPS):
        both = [
            figures[key] for direction in DIRECTIONS if (key := f"{name}_{direction}") in figures
        ]
        if len(both) == len(DIRECTIONS):
            figures[name] = float(np.mean(both))
    return figures


def tracking_lag(fine: Fine) -> tuple[float, float]:
    """Return the lag of the position behind the command, and its standard deviation [s].

    The lag is the slope of a regression of the tracking error on the commanded speed. Without a
    command, both values are NaN. If the command moves too little, the lag is NaN and its standard
    deviation infinite.
    """
    if fine.command is None:
        return math.nan, math.nan
    rate = np.gradient(smoothed(fine.command, 2.0), fine.step_s)
    moving = np.abs(rate) > 0.05 * np.max(np.abs(rate), initial=0.0)
    if np.sum(moving) < _FEWEST:
        return math.nan, math.inf
    error, rate = (fine.command - fine.position)[moving], rate[moving]
    rate = rate - np.mean(rate)
    error = error - np.mean(error)
    power = float(rate @ rate)
    lag = float(rate @ error) / power
    residuals = error - lag * rate
    count = len(residuals)
    independent = max(1, count // 20)
    return lag, math.sqrt(float(residuals @ residuals) / count / power * count / independent)


def lost_motion(
    telemetry: Telemetry, description: ActuatorDescription, preparation: Preparation
) -> tuple[float, float]:
    """Return the lost motion between motor and joint, and its standard deviation [rad].

    If the speed is measured at the motor and the position at the joint, the integral of the speed
    minus the position changes by the play at each reversal. Both values are NaN without a measured
    speed, or with too few reversals.
    """
    speed = user_speed(telemetry, description)
    if speed is None:
        return math.nan, math.nan
    h = telemetry.sample_period
    turned = np.concatenate([[0.0], np.cumsum(0.5 * h * (speed[1:] + speed[:-1]))])
    usual = preparation.usual_speed
    smooth = smoothed(speed, max(1.0, 0.005 / h))
    direction = np.sign(smooth) * (np.abs(smooth) > 0.25 * usual)
    begins = np.flatnonzero(np.diff(np.concatenate([[0.0], direction])) != 0.0)
    ends = np.append(begins[1:], len(direction))
    strokes = [
        (b, e, direction[b])
        for b, e in zip(begins, ends, strict=True)
        if direction[b] and e - b >= 5
    ]
    gap = turned - telemetry.position
    differences = []
    for (b0, e0, w0), (b1, e1, w1) in pairwise(strokes):
        if w0 == w1 or (b1 - e0) * h > 1.0:
            continue
        before, after = np.median(gap[b0:e0]), np.median(gap[b1:e1])
        # An error of the speed scale makes the gap drift by half a stroke between the middles of
        # two strokes. The drift changes its sign from pair to pair, so that the median cancels it.
        differences.append(w1 * float(after - before))
    if len(differences) < _FEWEST_TURNS:
        return math.nan, math.nan
    values = np.array(differences)
    centre = float(np.median(values))
    spread = 1.4826 * float(np.median(np.abs(values - centre)))
    return centre, max(spread, _TINY) / math.sqrt(len(values))
