# SPDX-License-Identifier: Apache-2.0
"""Simple fits and an oracle as references, for lives by foreign laws.

The fits know which component ends life, and the time of a repair; they use no tests before it. A
fit predicts as soon as a line through its tests rises by three standard errors.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import linregress

from ema_core.faults import FAULT_NAMES, healthy_faults
from ema_monitor.prognosis.growth.measurement import Measurement
from prognosis.foreign_lives import ForeignLife, continued
from prognosis.lives import LIMITS
from prognosis.predictors import Predictions, predicted

SAMPLES: Final = 200
LATEST: Final = 60
"""Number of latest tests that the fit ``_latest_line`` uses."""

_LEAST_TESTS: Final = 5
_SIGNIFICANT: Final = 3.0
_ORACLE_STEP_HOURS: Final = 5.0
_ORACLE_HOURS: Final = 4000.0

Array = NDArray[np.float64]
Fit = Callable[[Array, Array, np.random.Generator], Array | None]
"""Function that returns samples of the hours to the limit [h], or None without a prediction.

Its arguments are the hours of tests relative to the latest test, ``(n,)`` [h], shares of the limit,
``(n,)``, and a random generator.
"""


def followed(fit: Fit, life: ForeignLife, measurements: Sequence[Measurement]) -> Predictions:
    """Return the predictions of a fit after each test of a life."""
    name = life.grown[0].name
    column = FAULT_NAMES.index(name)
    rng = np.random.default_rng(0)
    used = [measurement for measurement in measurements if measurement.hours >= life.start_hours]
    hours = np.array([entry.hours for entry in used])
    share = np.array([entry.faults[column] for entry in used]) - healthy_faults()[column]
    share *= life.grown[0].side / LIMITS[name]
    shown = np.array([not entry.unobservable[column] for entry in used])
    before = len(measurements) - len(used)

    def after(number: int) -> Array | None:
        seen = np.flatnonzero(shown[: max(number - before + 1, 0)])
        if seen.size < _LEAST_TESTS:
            return None
        return fit(hours[seen] - hours[number - before], share[seen], rng)

    return predicted(measurements, after)


def _polynomial(t: Array, y: Array, degree: int, rng: np.random.Generator) -> Array | None:
    """Return samples of coefficients, constant first, ``(n, k)``.

    None with fewer than ``degree`` + 3 points, or if a line through the points does not rise.
    """
    if t.size < degree + 3 or not _rises(t, y):
        return None
    scale = max(-t[0], 1.0)
    design = np.vander(t / scale, degree + 1, increasing=True)
    covariance = np.linalg.pinv(design.T @ design)
    figures = covariance @ design.T @ y
    scatter = float(np.sum((y - design @ figures) ** 2)) / (t.size - degree - 1)
    root = np.linalg.cholesky(scatter * covariance + 1e-18 * np.eye(degree + 1))
    drawn = figures + rng.standard_normal((SAMPLES, degree + 1)) @ root.T
    return drawn / scale ** np.arange(degree + 1)


def _rises(t: Array, y: Array) -> bool:
    """Return whether the slope of a line is positive and exceeds three standard errors."""
    line: Any = linregress(t, y)
    return line.slope > max(_SIGNIFICANT * line.stderr, 0.0)


def _line(t: Array, y: Array, rng: np.random.Generator) -> Array | None:
    drawn = _polynomial(t, y, 1, rng)
    if drawn is None:
        return None
    level, slope = drawn.T
    until = np.maximum(1.0 - level, 0.0) / np.where(slope > 0.0, slope, np.nan)
    return np.nan_to_num(until, nan=np.inf)


def _latest_line(t: Array, y: Array, rng: np.random.Generator) -> Array | None:
    return _line(t[-LATEST:], y[-LATEST:], rng)


def _quadratic(t: Array, y: Array, rng: np.random.Generator) -> Array | None:
    drawn = _polynomial(t, y, 2, rng)
    if drawn is None:
        return None
    c, b, a = drawn.T
    c = np.minimum(c - 1.0, 0.0)
    under = b**2 - 4.0 * a * c
    # The first crossing, in the form that is exact for a = 0.
    root = -2.0 * c / (b + np.sqrt(np.maximum(under, 0.0)))
    return np.where((under >= 0.0) & (root >= 0.0), root, np.inf)


def _exponential(t: Array, y: Array, rng: np.random.Generator) -> Array | None:
    """Fit a line to log y with weights y^2, and resample its residuals.

    Return samples of the remaining life [h], or None if y does not rise or has too few points.
    """
    if not _rises(t, y):
        return None
    used = y > 0.01
    t, y = t[used], y[used]
    if t.size < _LEAST_TESTS or np.ptp(t) == 0.0:
        return None
    scale = max(-t[0], 1.0)
    design = np.column_stack([np.ones_like(t), t / scale])
    weighted = design * y[:, None] ** 2
    inverse = np.linalg.pinv(weighted.T @ design) @ weighted.T
    fitted = design @ (inverse @ np.log(y))
    residual = (np.log(y) - fitted) * y
    drawn = fitted + residual[rng.integers(y.size, size=(SAMPLES, y.size))] / y
    level, slope = inverse @ drawn.T
    slope = np.where(slope > 0.0, slope / scale, np.nan)
    return np.nan_to_num(np.maximum(-level, 0.0) / slope, nan=np.inf)


FITS: Final[Mapping[str, Callable[..., Predictions]]] = {
    "straight line": partial(followed, _line),
    "line of 60 tests": partial(followed, _latest_line),
    "quadratic": partial(followed, _quadratic),
    "exponential": partial(followed, _exponential),
}
"""Fits by name, which the tracker should outperform in every kind of life."""


def oracle(life: ForeignLife, measurements: Sequence[Measurement]) -> Predictions:
    """Return the predictions of an oracle, which continues the law from the true state.

    It knows the law, its parameters and its state, but not the future noise of growth, missions
    and shocks.
    """
    rng = np.random.default_rng(0)

    def after(number: int) -> Array | None:
        hours = measurements[number].hours
        left = np.full(SAMPLES, np.inf)
        for growth in life.grown if hours >= life.start_hours else ():
            at = max(int(np.searchsorted(growth.hours, hours, "right")) - 1, 0)
            ahead = min(_ORACLE_HOURS, 3.0 * (life.end_hours - hours) + 100.0)
            steps = hours - growth.since + np.arange(0.0, ahead, _ORACLE_STEP_HOURS)
            share = np.full(SAMPLES, float(np.interp(hours, growth.hours, growth.share)))
            states = np.tile(growth.states[at][:, None], SAMPLES)
            futures, _ = continued(growth.law, share, states, steps, life.noise, (rng, rng))
            wave = growth.law.wave(steps + growth.since) + np.zeros(steps.size)
            over = futures + wave[:, None] >= 1.0
            first = np.where(over.any(axis=0), steps[np.argmax(over, axis=0)], np.inf)
            left = np.minimum(left, np.maximum(first - steps[0] - 0.5 * _ORACLE_STEP_HOURS, 0.0))
        return left if np.any(np.isfinite(left)) else None

    return predicted(measurements, after)
