# SPDX-License-Identifier: Apache-2.0
"""Lag of the effort behind the motion in a record, measured at the reversals of friction."""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array, Flags
from ema_monitor.joint.signals import Fine, Preparation, filter_sigma
from ema_monitor.joint.smoothing import smoothed

LONGEST_LAG_S: Final = 0.16
"""Largest lag that is searched, in both directions [s]."""

_COARSE, _NARROW = 1.0, 0.25
"""Steps of the search, relative to the filter's standard deviation [-]."""
_LEAST_SHIFT, _CERTAIN_SHIFT = 0.05, 0.4
"""Smallest shift, and smallest certain shift, relative to the filter's standard deviation [-]."""
_SIGNIFICANT, _CERTAIN = 4.0, 12.0
"""Smallest shift, and smallest certain shift, in standard deviations of the lag [-]."""
_NORMAL: Final = 1.4826
_SOFT_SIGN: Final = 0.02
_SLOW: Final = 0.05
_ONE_WAY: Final = 0.95
_LAG_GAIN: Final = 0.9
_REACH: Final = 3.0
_FEWEST: Final = 30.0
_INDEPENDENT: Final = 3.0
_TINY: Final = 1e-12


class EffortLag(NamedTuple):
    """Lag of the effort behind the motion in a record."""

    lag_s: float = math.nan
    """The lag [s]; NaN if the record does not determine it."""
    sigma: float = math.nan
    """Standard deviation of the lag [s]; NaN if the record does not determine the lag."""
    shift_s: float = 0.0
    """Time shift that aligns the effort with the healthy records [s]."""
    is_certain: bool = False
    """Whether only a delay can explain the shift. Play, and friction that does not follow the sign
    of the speed, shift the lag by up to 0.3 standard deviations of the filter."""

    @property
    def unshifted(self) -> "EffortLag":
        """The lag without the shift."""
        return self._replace(shift_s=0.0, is_certain=False)


UNKNOWN_LAG: Final = EffortLag()
"""Lag of a record that does not determine the lag."""


def effort_lag(fine: Fine, preparation: Preparation) -> EffortLag:
    """Return the lag of the effort behind the motion in a record.

    The lag minimises the squared residual of a model with inertia, viscous and Coulomb friction,
    gravity and a constant, fitted to steady motion and reversals. The standard deviation is
    computed from the curvature of the squared residual, with one independent residual per three
    standard deviations of the filter.

    If there is too little motion, or no minimum within ``LONGEST_LAG_S``, the result is
    ``UNKNOWN_LAG``.
    """
    misfit = _Misfit(fine, preparation)
    if not misfit.is_enough:
        return UNKNOWN_LAG
    least = _least(misfit, filter_sigma(preparation.cutoff_hz))
    if least is None:
        return UNKNOWN_LAG
    lag, curvature, square = least
    variance = 2.0 * max(square, _TINY) / (misfit.independent * curvature)
    return EffortLag(lag, math.sqrt(variance))


def common_lag(blocks: Sequence[Fine], preparation: Preparation) -> float:
    """Return the common lag of the effort behind the motion in healthy records [s].

    The lag minimises the total misfit of all records in steady motion. Reversals are excluded,
    because play, and friction that does not follow the sign of the speed, shift the lag there. The
    model includes jerk and snap if the preparation is elastic. The lag of the preparation is
    returned if there is too little motion, or the lag does not reduce the RMS misfit by 10 %.
    """
    misfits = [_Misfit(block, preparation, is_steady=True) for block in blocks]
    misfits = [misfit for misfit in misfits if misfit.is_enough]
    assumed_lag_s = preparation.lag_s
    if not misfits:
        return assumed_lag_s

    def total(lag_s: float) -> float:
        return sum(misfit(lag_s) for misfit in misfits)

    least = _least(total, filter_sigma(preparation.cutoff_hz))
    if least is None or total(least.lag_s) > _LAG_GAIN**2 * total(assumed_lag_s):
        return assumed_lag_s
    return least.lag_s


class _Misfit:
    """Squared residual of the effort as a function of its lag [s].

    The model has inertia, friction and gravity. If ``is_steady``, reversals are excluded, and the
    model includes jerk and snap if the preparation is elastic.
    """

    def __init__(self, fine: Fine, preparation: Preparation, *, is_steady: bool = False) -> None:
        step = fine.step_s
        sigma = filter_sigma(preparation.cutoff_hz) / step
        rough = smoothed(fine.position, sigma / 3.0)
        if fine.speed is None:
            speed = np.gradient(rough, step)
        else:
            speed = smoothed(fine.speed, sigma / 3.0)
        usual = preparation.usual_speed
        sign = np.clip(speed / (_SOFT_SIGN * usual), -1.0, 1.0)
        position, sign, speed = smoothed(np.array([fine.position, sign, speed]), sigma)
        angle = position - np.mean(position)
        constant = np.ones(len(sign))
        acceleration = np.gradient(speed, step)
        design = np.column_stack(
            [acceleration, speed, sign, constant, np.sin(angle), np.cos(angle)]
        )
        self._rows = _rows(fine, speed, usual, sigma)
        if is_steady:
            self._rows &= np.abs(sign) > _ONE_WAY
            if preparation.is_elastic:
                jerk = np.gradient(acceleration, step)
                design = np.column_stack([design, jerk, np.gradient(jerk, step)])
        self._base, _ = np.linalg.qr(design[self._rows])
        self._time = step * np.arange(len(sign))
        self._effort, self._sigma = fine.effort, sigma

    @property
    def independent(self) -> float:
        """Number of independent rows."""
        return float(np.count_nonzero(self._rows)) / (_INDEPENDENT * self._sigma)

    @property
    def is_enough(self) -> bool:
        """Whether there are enough rows to measure a lag."""
        return self.independent >= _FEWEST

    def __call__(self, lag_s: float) -> float:
        shifted = np.interp(self._time + lag_s, self._time, self._effort)
        effort = smoothed(shifted, self._sigma)[self._rows]
        residuals = effort - self._base @ (self._base.T @ effort)
        return float(residuals @ residuals)


class _Least(NamedTuple):
    """Lag at the minimum of the misfit [s], with curvature and misfit at that lag."""

    lag_s: float
    curvature: float
    square: float


def _least(misfit: Callable[[float], float], sigma_s: float) -> _Least | None:
    """Return the minimum of the misfit, or None if there is none within ``LONGEST_LAG_S``.

    ``sigma_s`` is the standard deviation of the filter [s].
    """
    coarse, width = _COARSE * sigma_s, _NARROW * sigma_s
    count = math.ceil(LONGEST_LAG_S / coarse)
    near = min((coarse * i for i in range(-count, count + 1)), key=misfit)
    lags = near + width * np.arange(-5.0, 6.0)
    squares = np.array([misfit(lag) for lag in lags])
    best = int(np.argmin(squares))
    if abs(near) >= coarse * count or best in (0, len(lags) - 1):
        return None
    curvature, slope, square = _parabola(squares[best - 1 : best + 2], width)
    return _Least(float(lags[best]) - slope / curvature, curvature, square)


def with_shift(lag: EffortLag, healthy: Sequence[EffortLag], cutoff_hz: float) -> EffortLag:
    """Return a lag with its shift relative to the healthy records.

    The shift is 0 if it is not significant, or if the lag of the record or of all healthy records
    is unknown.

    Parameters
    ----------
    lag
        Lag of the record.
    healthy
        Lags of the healthy records.
    cutoff_hz
        Cut-off frequency of the filter [Hz].
    """
    unshifted = [
        healthy_lag.lag_s - healthy_lag.shift_s
        for healthy_lag in healthy
        if math.isfinite(healthy_lag.lag_s)
    ]
    if not unshifted or not math.isfinite(lag.lag_s):
        return lag.unshifted
    centre = float(np.median(unshifted))
    spread = _NORMAL * float(np.median(np.abs(np.array(unshifted) - centre)))
    sigma, width = math.hypot(lag.sigma, spread), filter_sigma(cutoff_hz)
    shift = lag.lag_s - centre
    if abs(shift) < max(_SIGNIFICANT * sigma, _LEAST_SHIFT * width):
        return lag.unshifted
    is_certain = abs(shift) > min(_CERTAIN * sigma, _CERTAIN_SHIFT * width)
    return lag._replace(shift_s=shift, is_certain=is_certain)


def aligned(fine: Fine, lag: EffortLag) -> Fine:
    """Return the columns of a record with the effort advanced by ``lag.shift_s``."""
    if not lag.shift_s:
        return fine
    time = fine.step_s * np.arange(len(fine.effort))
    return fine._replace(effort=np.interp(time + lag.shift_s, time, fine.effort))


def _parabola(squares: Array, width: float) -> tuple[float, float, float]:
    """Return curvature and slope at the middle of three values, and their parabola's minimum."""
    before, middle, after = squares.tolist()
    curvature = max((before - 2.0 * middle + after) / width**2, _TINY * middle / width**2)
    slope = (after - before) / (2.0 * width)
    return curvature, slope, middle - 0.5 * slope**2 / curvature


def _rows(fine: Fine, speed: Array, usual: float, sigma: float) -> Flags:
    """Return flags of the rows in or near motion, ``(n,)``.

    Rows at the ends and near unusable blocks are excluded.
    """
    ends = math.ceil(_REACH * sigma)
    around = np.ones(2 * ends + 1)
    rows = np.convolve(np.abs(speed) > _SLOW * usual, np.ones(math.ceil(sigma)), mode="same") > 0.5
    reach = ends + math.ceil(LONGEST_LAG_S / fine.step_s)
    rows[:reach] = rows[-reach:] = False
    if not np.all(fine.is_usable):
        rows &= np.convolve(~fine.is_usable, around, mode="same") < 0.5
    return rows
