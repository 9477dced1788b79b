# SPDX-License-Identifier: Apache-2.0
"""Rise of friction over healthy records, which suggests wear while a baseline is learned."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.shape import DRY

FEWEST: Final = 3
"""Minimum number of records, or of days, for a trend."""

_LEAST_RISE: Final = 0.1
_UNLIKELY: Final = 1e-2
_VARIANCE: Final = 0.02**2
"""Usual relative variance of healthy friction, between records and between days [-]."""
_WEIGHT: Final = 6
"""Weight of the usual scatter, as a number of records."""


def friction_rise(baseline: Baseline) -> float:
    """Return the relative rise of dry friction from the first to the last record [-].

    One line is fitted to the friction of the records in chronological order, another to the daily
    means; each needs at least three points. A rise counts as 0 if it is less than 10 %, or if
    healthy scatter explains it (one-sided test at 1e-2). The larger rise is returned. The assumed
    scatter is a weighted mean: the usual scatter of 2 % between records and between days with the
    weight of six records, and the measured scatter about the line. Falling friction, for example
    of a gear that warms up, is not a rise.
    """
    records = sorted(baseline.records, key=lambda record: record.stamp_ns)
    values = np.array([record.values[DRY] for record in records])
    values = values / np.median(values)
    _, days = np.unique([record.day for record in records], return_inverse=True)
    sizes = np.bincount(days)
    same_day = (days[:, None] == days).astype(float)
    day_values = np.bincount(days, values) / sizes
    return max(
        _rise(values, _VARIANCE * (np.eye(len(records)) + same_day)),
        _rise(day_values, _VARIANCE * np.diag(1.0 + 1.0 / sizes)),
    )


def _rise(values: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    """Return the rise of the line through values, ``(n,)``; 0 if scatter explains it.

    ``covariance``, ``(n, n)``, is the usual covariance of the values.
    """
    count = len(values)
    if count < FEWEST:
        return 0.0
    line = np.column_stack([np.ones(count), np.arange(count)])
    weighted = np.linalg.solve(covariance, line)
    errors = np.linalg.inv(line.T @ weighted)
    _, slope = coefficients = errors @ (weighted.T @ values)
    residuals = values - line @ coefficients
    freedom = _WEIGHT + count - 2
    scale = (_WEIGHT + float(residuals @ np.linalg.solve(covariance, residuals))) / freedom
    sigma = math.sqrt(scale * errors[1, 1])
    rise = float(slope) * (count - 1)
    is_rise = rise >= _LEAST_RISE and slope > sigma * student_t.isf(_UNLIKELY, freedom)
    return rise if is_rise else 0.0
