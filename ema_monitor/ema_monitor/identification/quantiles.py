# SPDX-License-Identifier: Apache-2.0
"""Quantiles of faults over several explanations.

The method is described in ``docs/identification.md``, M18.
"""

from statistics import NormalDist
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.faults import ECCENTRICITY_PHASE, HIGHEST, N_FAULTS

LEVELS: Final = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Probabilities of the quantiles of an estimate."""

_PARTS = 200
_NODES = np.array([NormalDist().inv_cdf((i + 0.5) / _PARTS) for i in range(_PARTS)])
_HIGHEST = np.where(np.arange(N_FAULTS) == ECCENTRICITY_PHASE, np.inf, HIGHEST)
_LOWEST = np.where(np.arange(N_FAULTS) == ECCENTRICITY_PHASE, -np.inf, 0.0)


def quantiles_of(weights: Array, means: Array, widths: Array) -> Array:
    """Return the quantiles of a mixture of normal distributions at `LEVELS`, ``(5, 8)``.

    The quantiles are limited to the range of each fault. They are NaN if a width is NaN.

    Parameters
    ----------
    weights, means
        Probability of each mean, ``(k,)``, and the means, ``(k, 8)``.
    widths
        Equally likely standard deviations about each mean, ``(m, 8)``.
    """
    around = (widths[:, None] * _NODES[:, None]).reshape(-1, N_FAULTS)
    values = (means[:, None] + around).reshape(-1, N_FAULTS)
    order = np.argsort(values, axis=0)
    shares = np.repeat(weights / len(around), len(around))[order]
    below = np.cumsum(shares, axis=0) - shares / 2.0
    sorted_values = np.take_along_axis(values, order, axis=0)
    quantiles = [np.interp(LEVELS, below[:, i], sorted_values[:, i]) for i in range(N_FAULTS)]
    return within_range(np.transpose(quantiles))


def within_range(faults: Array) -> Array:
    """Return fault vectors, ``(m, 8)``, limited to their range, except the eccentricity phase."""
    return np.clip(faults, _LOWEST, _HIGHEST)
