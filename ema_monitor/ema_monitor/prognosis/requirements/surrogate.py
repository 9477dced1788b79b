# SPDX-License-Identifier: Apache-2.0
"""Surrogate for a slow function of the faults, fitted to exact values at a few points.

The surrogate is a linear trend with kriging of its residuals (universal kriging; Santner, Williams
and Notz, The Design and Analysis of Computer Experiments, Springer 2018, chapter 3).
"""

from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.faults import (
    BACKLASH,
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    GAIN,
    HIGHEST,
    SHORT_CIRCUITS,
    eccentricity_vector,
)

CORRELATION_LENGTH: Final = 0.5
"""Correlation length of the trend's error, in ``coordinates`` [-]."""

NUGGET: Final = 1e-3
"""Share of the trend's error variance that is not smooth [-]."""

_SMALLEST_BACKLASH = 0.005
_WIDEST_SHORT_CIRCUIT = 0.5
_RIDGE = 1e-3


def coordinates(faults: Array) -> Array:
    """Return coordinates of fault vectors, ``(n, 8)``, in which performance is smooth.

    Eccentricity becomes ``zeta cos(phi)`` and ``zeta sin(phi)``. Backlash becomes its square root,
    because the torque needed to cross a play grows with the square root. A short circuit counts up
    to half the turns.
    """
    x = np.clip(faults, 0.0, HIGHEST)
    x[:, ECCENTRICITY], x[:, ECCENTRICITY_PHASE] = eccentricity_vector(x)
    x[:, BACKLASH] = np.sqrt(x[:, BACKLASH] + _SMALLEST_BACKLASH)
    x[:, SHORT_CIRCUITS] = np.minimum(x[:, SHORT_CIRCUITS], _WIDEST_SHORT_CIRCUIT)
    x[:, GAIN] = 2.0 * x[:, GAIN] - 1.0
    return x


class Surrogate:
    """A linear trend through exact values, with kriged residuals.

    Parameters
    ----------
    faults
        Fault vectors with known values, ``(k, 8)``.
    exact
        Exact values at these vectors, ``(k,)``.
    """

    def __init__(self, faults: Array, exact: Array) -> None:
        self._points = coordinates(faults)
        self._center, self._mean = self._points.mean(axis=0), float(exact.mean())
        away, k = self._points - self._center, len(exact)
        normal = away.T @ away + _RIDGE * k * np.eye(away.shape[1])
        self._slope = np.linalg.solve(normal, away.T @ (exact - self._mean))
        missed = exact - self._mean - away @ self._slope
        correlation = _correlation(self._points, self._points) + NUGGET * np.eye(k)
        self._weights = np.linalg.solve(correlation, missed)

    def at(self, faults: Array) -> Array:
        """Return the values, ``(m,)``, at fault vectors, ``(m, 8)``."""
        x = coordinates(faults)
        trend = self._mean + (x - self._center) @ self._slope
        return trend + _correlation(x, self._points) @ self._weights


def _correlation(rows: Array, columns: Array) -> Array:
    """Return the correlation between points, ``(m, k)``: a rational quadratic kernel of power 4."""
    squares = np.sum(rows**2, axis=1)[:, None] + np.sum(columns**2, axis=1)
    squares -= 2.0 * rows @ columns.T
    return (1.0 + 0.125 * np.maximum(squares, 0.0) / CORRELATION_LENGTH**2) ** -4
