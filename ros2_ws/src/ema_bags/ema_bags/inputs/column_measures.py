# SPDX-License-Identifier: Apache-2.0
"""Measures of single columns and pairs of columns: steps, repetition, saturation, lags."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.columns.repetition import held_samples

_Array = NDArray[np.float64]

_MOST_ROWS: Final = 200_000
_MERGED: Final = 1e-9
_FEWEST_STEPS: Final = 10
_ALIKE: Final = 1.1
_FINEST: Final = 1e-6
_MOST_DIVISOR: Final = 12
_WHOLE: Final = 0.05
_MOSTLY_WHOLE: Final = 0.97
_MOST_LEVELS: Final = 50_000
_AT_EXTREME: Final = 1e-6
_LEAST_RUN: Final = 3
_MOVING: Final = 0.05
_LONGEST_LAG_S: Final = 0.5
_SMOOTH_S: Final = 0.01
_SMOOTH_SAMPLES: Final = 1.5
_CORRELATED: Final = 0.7
_BLOCKS: Final = 10
_LEAST_EXPLAINED: Final = 0.5
_CLEARER: Final = 0.6
_LONGEST_EFFORT_LAG_S: Final = 0.05
_MOST_SHIFTS: Final = 25
_FEWEST_ROWS: Final = 50


def quantisation_step(values: _Array) -> float:
    """Return the largest step that divides all differences of values; NaN if none is visible."""
    finite = values[np.isfinite(values)][:_MOST_ROWS]
    levels = np.unique(finite)
    if len(levels) < 2:
        return math.nan
    span = float(levels[-1] - levels[0])
    steps = np.diff(levels)
    # Levels that differ by rounding errors are equal.
    steps = steps[steps > _MERGED * float(np.max(np.abs(levels)))]
    if len(levels) > _MOST_LEVELS or not len(steps):
        return math.nan
    smallest = float(np.min(steps))
    smallest = float(np.mean(steps[steps < _ALIKE * smallest]))
    if len(steps) < _FEWEST_STEPS:
        return smallest if float(np.max(steps)) < _ALIKE * float(np.min(steps)) else math.nan
    for divisor in range(1, _MOST_DIVISOR + 1):
        step = smallest / divisor
        if step < _FINEST * span:
            break
        counts = steps / step
        # Large multiples of an inexact step are not whole: only judge small ones.
        judged = counts < 1.0 / _WHOLE
        if np.count_nonzero(judged) < _FEWEST_STEPS:
            break
        off = np.abs(counts - np.rint(counts))[judged]
        if np.mean(off < _WHOLE) > _MOSTLY_WHOLE:
            return step
    return math.nan


class Held(NamedTuple):
    """Repetition of values during motion."""

    every: int
    """Samples per update of the value; 1 if every sample is updated, 0 if unknown."""
    share: float
    """Share of the samples that repeat the previous value [-]."""
    longest: int
    """Largest number of successive samples with the same value."""


def held_values(values: _Array, is_moving: NDArray[np.bool_]) -> Held:
    """Return how often a column repeats its previous value during motion; both are ``(n,)``."""
    if len(values) < 2:
        return Held(0, math.nan, 0)
    is_repeated = np.concatenate([[False], np.diff(values) == 0.0]) & is_moving
    moving = int(np.count_nonzero(is_moving))
    share = float(np.count_nonzero(is_repeated)) / moving if moving else math.nan
    edges = np.flatnonzero(np.diff(is_repeated, prepend=False, append=False))
    longest = int(np.max(edges[1::2] - edges[::2], initial=0)) + 1
    return Held(held_samples(values), share, longest)


def saturated_share(values: _Array) -> float:
    """Return the share of samples in runs of at least three at the largest absolute value [-]."""
    finite = values[np.isfinite(values)]
    if len(finite) < _LEAST_RUN:
        return 0.0
    size = np.abs(finite)
    largest = float(np.max(size))
    if largest <= 0.0 or float(np.ptp(finite)) <= 0.0:
        return 0.0
    at = np.concatenate([[False], size >= largest * (1.0 - _AT_EXTREME), [False]])
    edges = np.flatnonzero(np.diff(at))
    runs = edges[1::2] - edges[::2]
    return float(np.sum(runs[runs >= _LEAST_RUN])) / len(finite)


def moving_mask(speed: _Array) -> NDArray[np.bool_]:
    """Return a mask, ``(n,)``, of the samples in which a joint moves.

    A joint moves if it is faster than 5 % of the 95th percentile of its speed.
    """
    size = np.abs(speed)
    fast = float(np.percentile(size, 95.0)) if len(size) else 0.0
    return size > max(_MOVING * fast, 0.0)


def smoothed(values: _Array, period: float, seconds: float = _SMOOTH_S) -> _Array:
    """Return a column after a Gaussian low-pass filter without lag, ``(n,)``.

    ``seconds`` is the standard deviation of the filter, at least 1.5 samples. A column that is not
    longer than the filter is returned unchanged.
    """
    width = max(seconds / period, _SMOOTH_SAMPLES)
    reach = math.ceil(4.0 * width)
    if len(values) <= 2 * reach:
        return values
    kernel: _Array = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    padded = np.pad(values, reach, mode="reflect", reflect_type="odd")
    return np.convolve(padded, kernel / np.sum(kernel), mode="valid").astype(np.float64)


def lag_between(cause: _Array, effect: _Array, period: float) -> float:
    """Return the lag of ``effect`` behind ``cause`` [s], by cross-correlation.

    Both are ``(n,)`` and sampled at the same times. They should be rates of change, such as speeds.
    Return NaN if there are fewer than 50 samples, their correlation is below 0.7, or the lag
    exceeds 0.5 s.
    """
    n = len(cause)
    if n < 50:
        return math.nan
    reach = min(round(_LONGEST_LAG_S / period), n // 4)
    cause = cause - np.mean(cause)
    # The same samples of the effect are compared at each lag.
    inner = slice(reach, n - reach)
    compared = np.zeros(n)
    compared[inner] = effect[inner] - np.mean(effect[inner])
    size = 1 << (2 * n - 1).bit_length()
    product = np.fft.irfft(np.conj(np.fft.rfft(cause, size)) * np.fft.rfft(compared, size), size)
    lags = np.arange(-reach, reach + 1)
    sums = np.cumsum(np.pad(np.array([cause, cause**2]), ((0, 0), (1, 0))), axis=1)
    mean, power = (sums[:, n - reach - lags] - sums[:, reach - lags]) / (n - 2 * reach)
    variance = np.maximum(power - mean**2, 0.0) * (n - 2 * reach)
    scale = np.sqrt(variance * float(compared @ compared))
    if not np.all(scale > 0.0):
        return math.nan
    correlation = product[lags] / scale
    best = int(np.argmax(np.abs(correlation)))
    if abs(correlation[best]) < _CORRELATED or best in (0, len(lags) - 1):
        return math.nan
    left, middle, right = np.abs(correlation[best - 1 : best + 2])
    curvature = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / curvature if curvature < 0.0 else 0.0
    return float((lags[best] + shift) * period)


def _cross_validated(terms: _Array, target: _Array) -> float:
    """Return the share of a column's variance that terms explain in blocks not fitted [-]."""
    block = np.arange(len(target)) * _BLOCKS // len(target) % 2 == 0
    shares = []
    for fitted in (block, ~block):
        weights, *_ = np.linalg.lstsq(terms[fitted], target[fitted], rcond=None)
        residual = target[~fitted] - terms[~fitted] @ weights
        shares.append(1.0 - float(np.var(residual)) / max(float(np.var(target[~fitted])), 1e-300))
    return min(shares)


class EffortFit(NamedTuple):
    """Least-squares fit of an effort by inertia, friction and gravity."""

    explained: float
    """Cross-validated share of the effort's variance that the motion explains [-]."""
    lag_s: float
    """Lag of the effort behind the motion [s]; NaN if the fit does not show it."""
    inertia: float
    """Standard deviation of the inertial effort, divided by the dry friction [-]."""
    gravity: float
    """Standard deviation of the gravity effort, divided by the dry friction [-]."""


def fit_effort(position: _Array, effort: _Array, period: float) -> EffortFit | None:
    """Fit an effort by inertia, friction and gravity; return None if there is too little motion.

    Parameters
    ----------
    position, effort
        Columns of a gapless run, ``(n,)``.
    period
        Sample period [s].
    """
    n = len(position)
    if n < 100 or float(np.ptp(position)) <= 0.0 or float(np.ptp(effort)) <= 0.0:
        return None
    # Differentiating twice needs a filter that is wide relative to the quantisation.
    width = max(0.02, 3.0 * period)
    smooth = smoothed(position, period, width)
    speed = np.gradient(smooth, period)
    acceleration = np.gradient(speed, period)
    filtered = smoothed(effort, period, width)
    is_moving = moving_mask(speed)
    centred = (smooth - np.mean(smooth)) / max(float(np.ptp(smooth)), 1e-300)
    terms = np.column_stack(
        [
            acceleration,
            # The effort is filtered, so its steps at reversals are filtered, too.
            smoothed(np.sign(speed) * is_moving, period, width),
            speed,
            centred,
            centred**2,
            np.ones(n),
        ]
    )
    terms /= np.maximum(np.max(np.abs(terms), axis=0), 1e-300)

    reach = max(1, min(round(_LONGEST_EFFORT_LAG_S / period), _MOST_SHIFTS))
    rows = np.flatnonzero(is_moving)
    rows = rows[(rows >= reach) & (rows < n - reach)]
    if len(rows) < _FEWEST_ROWS:
        return None
    target = filtered[rows]

    def residual(shift: int) -> float:
        """Return the residual variance if the effort lags by ``shift`` samples."""
        weights, *_ = np.linalg.lstsq(terms[rows - shift], target, rcond=None)
        return float(np.var(target - terms[rows - shift] @ weights))

    variances = np.array([residual(shift) for shift in range(-reach, reach + 1)])
    best = int(np.argmin(variances))
    lag, variance = math.nan, float(np.var(target))
    if best not in (0, 2 * reach) and variances[best] < (1.0 - _LEAST_EXPLAINED) * variance:
        before, at, after = variances[best - 1 : best + 2]
        # A flat optimum does not show the lag; a small gain may be due to another friction law.
        if at < _CLEARER * min(variances[0], variances[-1]):
            shift = best - reach + 0.5 * float((before - after) / (before - 2.0 * at + after))
            is_late = at < _CLEARER * variances[reach]
            lag = shift * period if is_late or abs(shift) < 1.0 else 0.0
    rows = rows - round(lag / period) if math.isfinite(lag) else rows
    explained = _cross_validated(terms[rows], target)
    weights, *_ = np.linalg.lstsq(terms[rows], target, rcond=None)
    friction = max(abs(float(weights[1])), 1e-300)
    gravity = terms[rows][:, 3:5] @ weights[3:5]
    return EffortFit(
        explained,
        lag,
        float(np.std(terms[rows, 0] * weights[0])) / friction,
        float(np.std(gravity)) / friction,
    )
