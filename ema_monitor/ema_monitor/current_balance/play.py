"""The free play between motor and shaft, from what the one turns while the other stands (M42)."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_monitor.current_balance.columns import MotorMotion

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


class OneWay(NamedTuple):
    """Samples ``first`` to ``last`` (included) in which the shaft moves one way."""

    first: int
    last: int
    way: float


@dataclass(frozen=True)
class Play:
    """Free play that a motion shows.

    Attributes
    ----------
    width, sigma
        Full width at the motor, and its standard deviation [rad].
    middle
        What has to be added to the angle turned by the motor, in the middle of its play, to be that
        of the shaft [rad].
    reversals
        Number of reversals that it rests on.
    by_error
        Whether the motor's speed was derived from the position error and not measured.
    """

    width: float
    sigma: float
    middle: float
    reversals: int
    by_error: bool


def runs_of(shaft: NDArray[np.float64], step_s: float) -> list[OneWay]:
    """Return the runs one way of a shaft, at the ends of which motor and shaft touch.

    Parameters
    ----------
    shaft
        Its angle, ``(n,)`` [rad].
    step_s
        Time between samples [s].
    """
    steps = np.diff(shaft)
    moving = np.abs(steps)[steps != 0.0]
    if not moving.size:
        return []
    rms = float(np.sqrt(np.mean(steps**2)))
    # One digit of the sensor is no motion where it moves by many of them.
    digit = float(np.min(moving)) if np.min(moving) < 0.2 * rms else 0.0
    way = np.sign(steps) * (np.abs(steps) > max(_SLOW * rms, _RESOLVED * digit))
    changes = np.flatnonzero(np.diff(way)) + 1
    begins = np.concatenate([[0], changes])
    ends = np.concatenate([changes, [len(way)]])
    least = max(_FEWEST_STEPS, round(_RUN_S / step_s))
    return [
        OneWay(int(begin) + 1, int(end), float(way[begin]))
        for begin, end in zip(begins, ends, strict=True)
        if way[begin] != 0.0 and end - begin >= least
    ]


def free_play(columns: MotorMotion) -> Play | None:
    """Return the free play that a motion shows; None where it does not reverse twice.

    Between two runs of the shaft in opposite directions the motor turns by the play more than the
    shaft. Where its speed is not measured, the position error and the current tell it: a speed
    loop in proportion makes ``omega_m = q_1 (command - position) + q_2 I + q_3``, whatever its
    gains, which are fitted in the runs.
    """
    h, shaft = columns.step_s, columns.shaft
    runs = runs_of(shaft, h)
    time: NDArray[np.float64] = h * np.arange(float(len(shaft)))
    bases = _bases(columns, time)
    fitted = _within_runs(shaft, bases, runs)
    if fitted is None:
        return None
    slopes, covariance = fitted
    left = shaft - bases @ slopes
    ends = max(1, round(_ENDS_S / h))
    widths, gaps, last = [], [], None
    for run in runs:
        first = slice(run.first, min(run.first + ends, run.last + 1))
        if last is not None and last.way != run.way:
            before = slice(max(last.first, last.last + 1 - ends), last.last + 1)
            if time[run.first] - time[last.last] <= _LONGEST_GAP_S:
                widths.append(-run.way * (np.mean(left[first]) - np.mean(left[before])))
                gap = bases[first].mean(axis=0) - bases[before].mean(axis=0)
                gaps.append(run.way * gap)
        last = run
    if len(widths) < _FEWEST_TURNS:
        return None
    width, sigma = _robust_mean(np.array(widths))
    common = np.mean(gaps, axis=0)
    sigma = float(np.sqrt(sigma**2 + common @ covariance @ common))
    sides = np.concatenate([np.full(run.last + 1 - run.first, run.way) for run in runs])
    inside = np.concatenate([np.arange(run.first, run.last + 1) for run in runs])
    turned = columns.turned if columns.speed is not None else shaft
    middle = float(np.mean(shaft[inside] + sides * width / 2.0 - turned[inside]))
    return Play(width, sigma, middle, len(widths), columns.speed is None)


def _bases(columns: MotorMotion, time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the angle of the motor is a sum of, ``(n, k)``."""
    if columns.speed is not None:
        return np.stack([columns.turned, time], axis=1)
    sums = np.zeros((len(time), 2))
    sums[1:, 0] = np.cumsum(columns.step_s * (columns.error[1:] + columns.error[:-1]) / 2.0)
    sums[1:, 1] = np.cumsum(columns.step_s * columns.current)
    return np.column_stack([sums, time])


def _within_runs(
    shaft: NDArray[np.float64], bases: NDArray[np.float64], runs: list[OneWay]
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return by which slopes the bases explain the shaft within its runs, and their covariance."""
    parts = [slice(run.first, run.last + 1) for run in runs if run.last - run.first >= 2]
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


def _robust_mean(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the mean of values with few outliers, and its standard deviation."""
    centre, scale = float(np.median(values)), _spread(values, float(np.median(values)))
    weights = np.ones(len(values))
    for _ in range(_PASSES):
        weights = 1.0 / np.maximum(1.0, np.abs(values - centre) / (_ROBUST * scale))
        centre = float(weights @ values / weights.sum())
        scale = _spread(values, centre)
    spread = float(np.sqrt(weights @ (values - centre) ** 2 / weights.sum()))
    return centre, max(spread, scale / 2.0) / np.sqrt(max(1, len(values) - 1))


def _spread(values: NDArray[np.float64], centre: float) -> float:
    return 1.4826 * float(np.median(np.abs(values - centre))) + _TINY
