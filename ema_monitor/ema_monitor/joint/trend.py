# SPDX-License-Identifier: Apache-2.0
"""Rise of friction over healthy records, which suggests wear while a baseline is learned."""

import math
from typing import Final

import numpy as np
from scipy.stats import t as student_t

from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.shape import DRY

FEWEST: Final = 4
"""Minimum number of records for a trend, and of days for a trend over days."""

_LEAST_RISE: Final = 0.1
_UNLIKELY: Final = 5e-3


def friction_rise(baseline: Baseline) -> float:
    """Return the relative rise of dry friction from the first to the last record [-].

    A line is fitted to friction over the number of the record: to the means of the days, if there
    are at least four, and otherwise to the records relative to the means of their days, because
    friction differs between days. The rise is 0 if it is less than 10 %, or if healthy scatter
    about the line explains it (5e-3, one-sided). Falling friction, as of a gear that warms up, is
    not a rise.
    """
    records = sorted(baseline.records, key=lambda record: record.stamp_ns)
    count = len(records)
    if count < FEWEST:
        return 0.0
    values = np.array([record.values[DRY] for record in records])
    values = values / np.median(values)
    _, days = np.unique([record.day for record in records], return_inverse=True)
    sizes = np.bincount(days)
    numbers = np.arange(count, dtype=float)
    day_numbers, day_values = (np.bincount(days, of) / sizes for of in (numbers, values))
    if len(sizes) >= FEWEST:
        x, y = day_numbers - np.mean(day_numbers), day_values - np.mean(day_values)
        freedom = len(sizes) - 2
    else:
        x, y = numbers - day_numbers[days], values - day_values[days]
        freedom = count - len(sizes) - 1
    square = float(x @ x)
    if freedom < 1 or not square:
        return 0.0
    slope = float(x @ y) / square
    left = y - slope * x
    sigma = math.sqrt(float(left @ left) / freedom / square)
    rise = slope * (count - 1)
    return (
        rise if rise >= _LEAST_RISE and slope > sigma * student_t.isf(_UNLIKELY, freedom) else 0.0
    )
