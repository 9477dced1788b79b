"""The band of a residual that carries information."""

from functools import cache
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.parameters import ActuatorParameters

BAND_S: Final = 2e-3
"""Length of the smoothing window [s]; above some 1 kHz there is only the ripple of the PWM."""


BAND_CORRELATION: Final = 4.0
"""How many values of a band-limited residual count as one that is independent [-]."""

# From this share of the smoothing window on, a sample itself is as good as its mean with the next.
_LONG_SAMPLE = 0.75


def band_samples(n: int, sample_period: float) -> int:
    """Return how many samples lie between two values of a band-limited row of ``n`` samples."""
    return max(1, min(round(BAND_S / sample_period / 2.0), n // 2))


def band_limited(rows: Array, sample_period: float) -> Array:
    """Return rows without the ripple that no model can match sample by sample.

    Parameters
    ----------
    rows
        Samples, ``(..., n)``.
    sample_period
        Their period [s].

    Returns
    -------
    numpy.ndarray
        Means under Hann windows of ``BAND_S``, each begun where the one before is half over,
        ``(..., n_band)``; samples at the end that fill no window are left out. Of samples longer
        than three quarters of it, these themselves.
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
    """Return the weight that converts a speed residual to current [A.s/rad].

    It is half the current that the speed loop makes of it (M15).
    """
    return 0.5 * parameters.GAP / parameters.k_t


def rms(values: Array) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(np.square(values))))
