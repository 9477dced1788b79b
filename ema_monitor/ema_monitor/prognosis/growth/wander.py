# SPDX-License-Identifier: Apache-2.0
"""Wandering pace: a random growth rate factor with a correlation time of 500 h.

Its logarithm z is an Ornstein-Uhlenbeck process with mean 0 and standard deviation ``SIGMA``. On a
grid of paces, it is approximated by a birth-death process with the same stationary distribution and
diffusion. The factor is scaled to mean 1.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core._jit import kernel
from ema_core.arrays import Array
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY

SIGMA: Final = 0.5
"""Standard deviation of the logarithm of the pace [-]."""

WANDER_HOURS: Final = 500.0
"""Correlation time of a pace [h]; values from 200 h to 2,000 h make little difference."""

PACES: Final = SIGMA * np.linspace(-2.4, 2.4, 7)
"""Grid of log-paces [-]."""

SHARES: Final = np.exp(-0.5 * (PACES / SIGMA) ** 2) / np.sum(np.exp(-0.5 * (PACES / SIGMA) ** 2))
"""Stationary probabilities of ``PACES`` [-]."""

LOG_MEAN: Final = float(np.log(np.sum(SHARES * np.exp(PACES))))
FACTORS: Final = np.exp(PACES - LOG_MEAN)
"""Rate factor of each pace, with mean 1 [-]."""

STEPS: Final = 24
"""Number of steps in which a wandering pace is simulated."""

_STEP_SHARE: Final = 1.0 / 12.0
_LEAST_WEIGHT: Final = 1e-270
_LEAST_VARIANCE: Final = 1e-14


def _generator() -> tuple[Array, Array, Array]:
    """Return eigenvalues, left and right vectors of the birth-death process's generator."""
    root = np.sqrt(SHARES)
    diffusion = SIGMA**2 / WANDER_HOURS / (PACES[1] - PACES[0]) ** 2
    # Detailed balance makes the scaled generator symmetric.
    neighbours = np.full(PACES.size - 1, diffusion)
    scaled = np.diag(neighbours, 1) + np.diag(neighbours, -1)
    scaled -= np.diag((scaled @ root) / root)
    values, vectors = np.linalg.eigh(scaled)
    return values, vectors / root[:, None], vectors.T * root


_GENERATOR: Final = _generator()


def transition(hours: ArrayLike) -> Array:
    """Return the transition probabilities between paces over the hours, ``(..., p, p)``."""
    values, left, right = _GENERATOR
    kept = np.exp(values * np.asarray(hours, dtype=np.float64)[..., None])
    return np.maximum((left * kept[..., None, :]) @ right, 0.0)


def mix_paces(
    weight: Array, mean: Array, variance: Array, blocks: NDArray[np.intp], hours: Array
) -> None:
    """Propagate the paces of cells in place, merging the states that arrive at each pace.

    Parameters
    ----------
    weight, mean, variance
        Probability, mean and variance of the level of each cell, ``(n,)``.
    blocks
        Indices of the cells of each curve by pace and rate, ``(b, p, r)``.
    hours
        Growth hours of each curve, ``(b,)`` [h].
    """
    moved = np.swapaxes(transition(hours), 1, 2)
    w, m = weight[blocks], mean[blocks]
    arriving = moved @ w
    first, second = moved @ (w * m), moved @ (w * (variance[blocks] + m**2))
    weight[blocks] = np.maximum(arriving, LEAST_PROBABILITY)
    comes = (arriving > _LEAST_WEIGHT) & (hours > 0.0)[:, None, None]
    at, arriving = blocks[comes], arriving[comes]
    mean[at] = first[comes] / arriving
    variance[at] = np.maximum(second[comes] / arriving - mean[at] ** 2, _LEAST_VARIANCE)


@kernel()
def followed(pace: Array, steps: Array, normal: Array) -> Array:
    """Return the effective growth time in each step of simulated paces, ``(m, n)`` [h].

    ``pace`` is the current log-pace, ``(n,)`` [-]. ``steps`` are step durations [h], and ``normal``
    standard normal samples, ``(m, n)`` each.
    """
    passed = np.empty(steps.shape)
    for i in range(pace.size):
        z, factor, kept, before = pace[i], math.exp(pace[i] - LOG_MEAN), 1.0, 0.0
        for k in range(steps.shape[0]):
            step = steps[k, i]
            if step != before:
                kept, before = math.exp(-step / WANDER_HOURS), step
            z = kept * z + SIGMA * math.sqrt(1.0 - kept * kept) * normal[k, i]
            after = math.exp(z - LOG_MEAN)
            passed[k, i] = 0.5 * step * (factor + after)
            factor = after
    return passed


def hours_of(paced_hours: Array, pace: Array, rng: np.random.Generator) -> Array:
    """Return the hours needed for an effective growth time at a wandering pace, ``(n,)`` [h].

    ``paced_hours`` is the effective growth time [h] and ``pace`` the current log-pace [-], both
    ``(n,)``. The pace is simulated for twice the effective growth time, in ``STEPS`` steps. Any
    remaining growth is assumed to proceed at the mean pace. If ``paced_hours`` is much shorter than
    ``WANDER_HOURS``, this underestimates the hours at paces below half of the mean.
    """
    step = paced_hours * _STEP_SHARE
    normal = rng.standard_normal((STEPS, paced_hours.size))
    passed = followed(pace, np.tile(step, (STEPS, 1)), normal)
    after = np.cumsum(passed, axis=0)
    steps_passed = np.count_nonzero(after < paced_hours, axis=0)
    last, samples = np.minimum(steps_passed, STEPS - 1), np.arange(paced_hours.size)
    left = paced_hours - (after[last, samples] - passed[last, samples])
    into = step * (last + left / passed[last, samples])
    return np.where(steps_passed < STEPS, into, STEPS * step + paced_hours - after[-1])
