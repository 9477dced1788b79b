"""A pace that wanders: a factor of the rate of growth that forgets itself in some hundred hours.

Its logarithm z is an Ornstein-Uhlenbeck process of mean 0 and standard deviation ``SIGMA``, on a
grid of paces: a birth and death process between neighbours with the same stationary distribution
and, between them, the same diffusion. The mean of the factor is 1.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core._jit import kernel
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY

SIGMA: Final = 0.5
"""Standard deviation of the logarithm of the pace [-]."""

WANDER_HOURS: Final = 500.0
"""Hours within which a pace forgets itself [h]; from 200 to 2,000 it matters little."""

PACES: Final = SIGMA * np.linspace(-2.4, 2.4, 7)
"""Logarithms of the paces of the grid [-]."""

SHARES: Final = np.exp(-0.5 * (PACES / SIGMA) ** 2) / np.sum(np.exp(-0.5 * (PACES / SIGMA) ** 2))
"""Their stationary probabilities [-]."""

LOG_MEAN: Final = float(np.log(np.sum(SHARES * np.exp(PACES))))
FACTORS: Final = np.exp(PACES - LOG_MEAN)
"""The paces: factors of the rate, of mean 1 [-]."""

STEPS: Final = 24
"""Steps in which a time of growth is followed into the future."""

_STEP_SHARE: Final = 1.0 / 12.0


def _generator() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return eigenvalues, left and right vectors of the rates of change between paces."""
    root = np.sqrt(SHARES)
    diffusion = SIGMA**2 / WANDER_HOURS / (PACES[1] - PACES[0]) ** 2
    # In detailed balance with the stationary probabilities, so symmetric when scaled.
    beside = np.full(PACES.size - 1, diffusion)
    scaled = np.diag(beside, 1) + np.diag(beside, -1)
    scaled -= np.diag((scaled @ root) / root)
    values, vectors = np.linalg.eigh(scaled)
    return values, vectors / root[:, None], vectors.T * root


_GENERATOR: Final = _generator()


def transition(hours: float) -> NDArray[np.float64]:
    """Return the probabilities from pace to pace, by row and column, over some hours [h]."""
    values, left, right = _GENERATOR
    return np.maximum((left * np.exp(values * hours)) @ right, 0.0)


@kernel()
def mix_paces(
    weight: NDArray[np.float64],
    mean: NDArray[np.float64],
    variance: NDArray[np.float64],
    starts: NDArray[np.intp],
    rates: int,
    probability: NDArray[np.float64],
) -> None:
    """Let the paces of cells change, in place, merging what comes to each.

    Parameters
    ----------
    weight, mean, variance
        Of all cells.
    starts
        First cells of the blocks of a curve.
    rates
        Number of rates of a curve.
    probability
        Probabilities from pace to pace, ``(p, p)``.
    """
    n = probability.shape[0]
    w, m, s = np.empty(n), np.empty(n), np.empty(n)
    for start in starts:
        for rate in range(rates):
            for to in range(n):
                w[to], m[to], s[to] = 0.0, 0.0, 0.0
                for at in range(n):
                    cell = start + at * rates + rate
                    part = probability[at, to] * weight[cell]
                    w[to] += part
                    m[to] += part * mean[cell]
                    s[to] += part * (variance[cell] + mean[cell] ** 2)
            for to in range(n):
                cell = start + to * rates + rate
                weight[cell] = max(w[to], LEAST_PROBABILITY)
                if w[to] > 1e-270:
                    mean[cell] = m[to] / w[to]
                    variance[cell] = max(s[to] / w[to] - mean[cell] ** 2, 1e-14)


@kernel()
def hours_of(
    own: NDArray[np.float64],
    pace: NDArray[np.float64],
    normal: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the hours in which a wandering pace makes growth pass its own hours.

    Parameters
    ----------
    own
        Hours at pace 1 [h], ``(n,)``.
    pace
        Logarithm of the pace now [-], ``(n,)``.
    normal
        Standard normal numbers, ``(n, STEPS)``.

    Returns
    -------
    numpy.ndarray
        Hours [h], ``(n,)``; at the pace reached after ``STEPS`` steps where they do not suffice.
    """
    result = np.empty(own.size)
    for i in range(own.size):
        z, done, spent = pace[i], 0.0, 0.0
        step = own[i] * _STEP_SHARE
        kept = np.exp(-step / WANDER_HOURS)
        spread = SIGMA * np.sqrt(1.0 - kept * kept)
        left = True
        for k in range(normal.shape[1]):
            after = z * kept + spread * normal[i, k]
            part = 0.5 * (np.exp(z - LOG_MEAN) + np.exp(after - LOG_MEAN)) * step
            if done + part >= own[i]:
                spent += step * (own[i] - done) / part
                left = False
                break
            done += part
            spent += step
            z = after
        if left:
            # Those that are slow for so long come back to the mean pace.
            spent += own[i] - done
        result[i] = spent
    return result
