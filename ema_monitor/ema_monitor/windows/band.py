# SPDX-License-Identifier: Apache-2.0
"""Band limitation of signals and residuals, to remove PWM ripple."""

from functools import cache
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.parameters import ActuatorParameters

BAND_S: Final = 2e-3
"""Length of the smoothing window [s]. Residuals above about 1 kHz are PWM ripple."""


BAND_CORRELATION: Final = 4.0
"""Number of values of a band-limited residual per independent value [-]."""

# Samples longer than this share of the smoothing window are not smoothed.
_LONG_SAMPLE = 0.75


def band_samples(n: int, sample_period: float) -> int:
    """Return the number of samples per band-limited value, for a row of ``n`` samples."""
    return max(1, min(round(BAND_S / sample_period / 2.0), n // 2))


def band_limited(rows: Array, sample_period: float) -> Array:
    """Return rows without PWM ripple, which no model can predict sample by sample.

    Parameters
    ----------
    rows
        Samples, ``(..., n)``.
    sample_period
        Sample period [s].

    Returns
    -------
    numpy.ndarray
        Means over Hann windows of length ``BAND_S`` with 50 % overlap, ``(..., n_band)``. Samples
        at the end that do not fill a window are omitted. If the sample period exceeds 75 % of
        ``BAND_S``, the rows are returned unchanged.
    """
    if sample_period > _LONG_SAMPLE * BAND_S:
        return rows
    half = band_samples(rows.shape[-1], sample_period)
    hann = _hann(half)
    n_band = rows.shape[-1] // half
    blocks = rows[..., : n_band * half].reshape(*rows.shape[:-1], n_band, half)
    return blocks[..., :-1, :] @ hann[:half] + blocks[..., 1:, :] @ hann[half:]


@cache
def _hann(half: int) -> Array:
    hann = 1.0 - np.cos(np.pi * (np.arange(2 * half) + 0.5) / half)
    return hann / np.sum(hann)


def speed_weight(parameters: ActuatorParameters) -> float:
    """Return the weight that converts a speed residual to a current residual [A.s/rad].

    It is half the current that the speed loop demands per unit of speed (M15).
    """
    return 0.5 * parameters.GAP / parameters.k_t


def rms(values: Array) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(np.square(values))))
