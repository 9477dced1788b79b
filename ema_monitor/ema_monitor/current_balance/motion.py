"""Motion of motor and shaft as the current balance reads it, and the free play in it (M40, M42)."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry

_SPAN_S: Final = 2e-3
_SPAN_WITHOUT_SPEED_S: Final = 3e-3
_SLOW: Final = 0.02
_RUN_S: Final = 3e-3
_FEWEST_STEPS: Final = 2
_ENDS_S: Final = 5e-3
_LONGEST_GAP_S: Final = 2.0
_FEWEST_TURNS: Final = 2
_ROBUST: Final = 2.0
_PASSES: Final = 10
_TINY: Final = 1e-12
_RESOLVED: Final = 1.5


@dataclass(frozen=True, eq=False)
class MotorMotion:
    """Motion between samples, ``n`` of them, and the steps between, ``n - 1``.

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
    current: Array
    turned: Array
    speed: Array | None
    shaft: Array
    error: Array

    @classmethod
    def of(cls, telemetry: Telemetry, description: ActuatorDescription) -> Self:
        """Return the motion in telemetry that was acquired as its description says.

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


def _integral(speed: Array, h: float) -> Array:
    """Return the integral of a speed from 0, ``(n,)``: trapezia, corrected for its curvature."""
    trapezia = np.concatenate([[0.0], np.cumsum(h * (speed[1:] + speed[:-1]) / 2.0)])
    if len(speed) < 3:
        return trapezia
    slope = np.gradient(speed)
    return trapezia - h / 12.0 * (slope - slope[0])


class OneWay(NamedTuple):
    """Samples ``first`` to ``last`` (included) in which the shaft moves one way."""

    first: int
    last: int
    way: float

    @property
    def samples(self) -> slice:
        """Its samples."""
        return slice(self.first, self.last + 1)


class Play(NamedTuple):
    """Free play that a motion shows: full width at the motor, and its sigma [rad].

    ``middle`` has to be added to the angle turned by the motor, in the middle of its play, to be
    that of the shaft [rad]; ``reversals`` is the number of reversals that it rests on.
    """

    width: float
    sigma: float
    middle: float
    reversals: int


def runs_of(shaft: Array, step_s: float) -> list[OneWay]:
    """Return the runs one way of a shaft [rad], at the ends of which motor and shaft touch."""
    steps = np.diff(shaft)
    moving = np.abs(steps)[steps != 0.0]
    if not moving.size:
        return []
    rms = float(np.sqrt(np.mean(steps**2)))
    # One digit of the sensor is no motion where it moves by many of them.
    digit = float(np.min(moving)) if np.min(moving) < 0.2 * rms else 0.0
    way = np.sign(steps) * (np.abs(steps) > max(_SLOW * rms, _RESOLVED * digit))
    changes = np.flatnonzero(np.diff(way)) + 1
    begins, ends = np.concatenate([[0], changes]), np.concatenate([changes, [len(way)]])
    least = max(_FEWEST_STEPS, round(_RUN_S / step_s))
    return [
        OneWay(int(begin) + 1, int(end), float(way[begin]))
        for begin, end in zip(begins, ends, strict=True)
        if way[begin] != 0.0 and end - begin >= least
    ]


def free_play(motion: MotorMotion) -> Play | None:
    """Return the free play that a motion shows; None where it does not reverse twice.

    Between two runs of the shaft in opposite directions the motor turns by the play more than the
    shaft. Where its speed is not measured, the position error and the current tell it: a speed
    loop in proportion makes ``omega_m = q_1 (command - position) + q_2 I + q_3``, whatever its
    gains, which are fitted in the runs.
    """
    h, shaft = motion.step_s, motion.shaft
    runs = runs_of(shaft, h)
    time: Array = h * np.arange(float(len(shaft)))
    if motion.speed is not None:
        bases = np.stack([motion.turned, time], axis=1)
    else:
        sums = np.zeros((len(time), 2))
        sums[1:, 0] = np.cumsum(h * (motion.error[1:] + motion.error[:-1]) / 2.0)
        sums[1:, 1] = np.cumsum(h * motion.current)
        bases = np.column_stack([sums, time])
    fitted = _within_runs(shaft, bases, runs)
    if fitted is None:
        return None
    slopes, covariance = fitted
    left = shaft - bases @ slopes
    ends = max(1, round(_ENDS_S / h))
    widths, gaps = [], []
    for last, run in pairwise(runs):
        if last.way == run.way or time[run.first] - time[last.last] > _LONGEST_GAP_S:
            continue
        first = slice(run.first, min(run.first + ends, run.last + 1))
        before = slice(max(last.first, last.last + 1 - ends), last.last + 1)
        widths.append(-run.way * (np.mean(left[first]) - np.mean(left[before])))
        gaps.append(run.way * (bases[first].mean(axis=0) - bases[before].mean(axis=0)))
    if len(widths) < _FEWEST_TURNS:
        return None
    width, sigma = _robust_mean(np.array(widths))
    common = np.mean(gaps, axis=0)
    sigma = float(np.sqrt(sigma**2 + common @ covariance @ common))
    sides = np.concatenate([np.full(run.last + 1 - run.first, run.way) for run in runs])
    inside = np.concatenate([np.arange(run.first, run.last + 1) for run in runs])
    middle = float(np.mean(shaft[inside] + sides * width / 2.0 - motion.turned[inside]))
    return Play(width, sigma, middle, len(widths))


def _within_runs(shaft: Array, bases: Array, runs: list[OneWay]) -> tuple[Array, Array] | None:
    """Return by which slopes the bases explain the shaft within its runs, and their covariance."""
    parts = [run.samples for run in runs if run.last - run.first >= 2]
    if not parts:
        return None
    target = np.concatenate([shaft[part] - shaft[part].mean() for part in parts])
    design = np.concatenate([bases[part] - bases[part].mean(axis=0) for part in parts])
    scales = np.sqrt(np.mean(design**2, axis=0))
    if len(target) < 4 * bases.shape[1] or not np.all(scales > 0.0):
        return None
    normal = (design / scales).T @ (design / scales)
    normal += 1e-9 * len(target) * np.eye(len(scales))
    inverse = np.linalg.inv(normal)
    slopes = inverse @ (design / scales).T @ target
    left = target - design / scales @ slopes
    # What is left of a run is one long wave: its samples are not independent.
    variance = float(left @ left) / max(1, 2 * len(parts))
    return slopes / scales, variance * inverse / np.outer(scales, scales)


def _robust_mean(values: Array) -> tuple[float, float]:
    """Return the mean of values with few outliers, and its standard deviation."""
    centre, weights = float(np.median(values)), np.ones(len(values))
    scale = _spread(values, centre)
    for _ in range(_PASSES):
        weights = 1.0 / np.maximum(1.0, np.abs(values - centre) / (_ROBUST * scale))
        centre = float(weights @ values / weights.sum())
        scale = _spread(values, centre)
    spread = float(np.sqrt(weights @ (values - centre) ** 2 / weights.sum()))
    return centre, max(spread, scale / 2.0) / np.sqrt(max(1, len(values) - 1))


def _spread(values: Array, centre: float) -> float:
    return 1.4826 * float(np.median(np.abs(values - centre))) + _TINY
