"""Surrogate of a slow function of the faults, corrected where it matters.

The trend is a cubic polynomial fitted once; what it leaves is kriged from a few exact values
(universal kriging; Santner, Williams and Notz, The Design and Analysis of Computer Experiments,
Springer 2018, chapter 3).
"""

from itertools import combinations_with_replacement
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core._jit import kernel
from ema_core.faults import (
    BACKLASH,
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    GAIN,
    HIGHEST,
    N_FAULTS,
    SHORT_CIRCUITS,
    eccentricity_vector,
)
from ema_core.simd import LANES, broadcast, load, store

CORRELATION_LENGTH: Final = 0.5
"""Distance in ``coordinates`` over which the error of the trend is alike [-]."""

NUGGET: Final = 1e-3
"""Share of that error's variance that is not smooth [-]."""

_SMALLEST_BACKLASH = 0.005
_WIDEST_SHORT_CIRCUIT = 0.5
_RIDGE = 1e-9

_WIDTH = N_FAULTS + 1
_NO_FAULTS, _NO_VALUES = np.empty((0, N_FAULTS)), np.empty(0)
_CUBIC = np.array(list(combinations_with_replacement(range(_WIDTH), 3)))


def coordinates(faults: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return coordinates of fault vectors, ``(n, 8)``, in which performance is smooth.

    Eccentricity becomes ``zeta cos(phi)`` and ``zeta sin(phi)``, the backlash its root, since the
    torque needed to cross a play grows with that; a short circuit counts to half the turns.
    """
    x = np.clip(faults, 0.0, HIGHEST)
    x[:, ECCENTRICITY], x[:, ECCENTRICITY_PHASE] = eccentricity_vector(x)
    x[:, BACKLASH] = np.sqrt(x[:, BACKLASH] + _SMALLEST_BACKLASH)
    x[:, SHORT_CIRCUITS] = np.minimum(x[:, SHORT_CIRCUITS], _WIDEST_SHORT_CIRCUIT)
    x[:, GAIN] = 2.0 * x[:, GAIN] - 1.0
    return x


def training_faults(n: int, seed: int) -> NDArray[np.float64]:
    """Draw fault vectors, ``(n, 8)``, that fill the range, more densely near the healthy state."""
    r = np.random.default_rng(seed).random((n, N_FAULTS))
    k = r**3 * HIGHEST
    k[:, SHORT_CIRCUITS] = r[:, SHORT_CIRCUITS] ** 3 * _WIDEST_SHORT_CIRCUIT
    k[:, ECCENTRICITY] = 0.9 * r[:, ECCENTRICITY] ** 3
    k[:, ECCENTRICITY_PHASE] = r[:, ECCENTRICITY_PHASE]
    off = 2.0 * r[:, GAIN] - 1.0
    k[:, GAIN] = 0.5 + 0.5 * np.sign(off) * np.abs(off) ** 1.5
    return k


@kernel()
def evaluate_surrogate(points, weights, known, known_weights, per_length, values):
    """Evaluate a cubic trend and a kriging correction at points, `LANES` at a time.

    ``points`` are ``(9, m)`` with ones in the first row; ``weights`` belong to the products of
    three rows. ``known`` points are ``(k, 9)``, in the same coordinates, with ``known_weights``.
    The results are stored in ``values``, ``(m, 1)``; m is a multiple of `ema_core.simd.LANES`. The
    correlation is the rational quadratic (1 + d^2 / 8)^-4, which needs no exponential, at the
    distance d in correlation lengths; ``per_length`` is the inverse of that length.
    """
    width = points.shape[0]
    for first in range(0, points.shape[1], LANES):
        total = broadcast(0.0)
        c = 0
        for i in range(width):
            of_i = broadcast(0.0)
            for j in range(i, width):
                of_j = broadcast(0.0)
                for k in range(j, width):
                    of_j += weights[c] * load(points[k], first)
                    c += 1
                of_i += of_j * load(points[j], first)
            total += of_i * load(points[i], first)
        for p in range(known.shape[0]):
            squares = broadcast(0.0)
            for i in range(1, width):
                difference = load(points[i], first) - known[p, i]
                squares += difference * difference
            nearness = 1.0 / (1.0 + 0.125 * per_length * per_length * squares)
            nearness *= nearness
            total += known_weights[p] * nearness * nearness
        store(values, first, 0, total)


def trend_weights(faults: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fit cubic polynomials in the coordinates of fault vectors, ``(n, 8)``, to values, ``(n, q)``.

    Returns the weights of the products of three coordinates or ones, ``(q, 165)``.
    """
    design = _with_ones(faults).T[_CUBIC].prod(axis=1)
    normal = design @ design.T + _RIDGE * len(faults) * np.eye(len(_CUBIC))
    return np.ascontiguousarray(np.linalg.solve(normal, design @ values).T)


class Surrogate:
    """A trend, and what it leaves of the value kriged from exact values at a few points.

    Parameters
    ----------
    weights
        Those of the trend, ``(165,)``.
    faults
        Fault vectors where the value is known, ``(k, 8)``; k may be 0.
    exact
        The value there, ``(k,)``.
    """

    def __init__(
        self,
        weights: NDArray[np.float64],
        faults: NDArray[np.float64] = _NO_FAULTS,
        exact: NDArray[np.float64] = _NO_VALUES,
    ) -> None:
        self._weights = weights.copy()
        self._known, self._known_weights = np.empty((0, _WIDTH)), np.empty(0)
        if len(faults):
            missed = exact - self.at(faults)
            mean = float(missed.mean())
            # The first product of the trend is that of three ones.
            self._weights[0] += mean
            known = _with_ones(faults)
            between = known[:, None] - known
            gram = (1.0 + 0.125 * (between**2).sum(axis=2) / CORRELATION_LENGTH**2) ** -4
            gram += NUGGET * np.eye(len(known))
            self._known, self._known_weights = known, np.linalg.solve(gram, missed - mean)

    def at(self, faults: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values, ``(m,)``, at fault vectors, ``(m, 8)``."""
        m = len(faults)
        points = np.ones((_WIDTH, -(-m // LANES) * LANES))
        points[1:, :m] = coordinates(faults).T
        values = np.empty((points.shape[1], 1))
        surrogate = (self._weights, self._known, self._known_weights, 1.0 / CORRELATION_LENGTH)
        evaluate_surrogate(points, *surrogate, values)
        return values[:m, 0]


def _with_ones(faults: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([np.ones(len(faults)), coordinates(faults)])
