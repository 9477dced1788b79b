"""The band of a residual current that carries information."""

import numpy as np
from numpy.typing import NDArray

BAND_S = 2e-3
"""Length of the smoothing window [s]; above some 1 kHz there is only the ripple of the PWM."""


def band_limited(residual: NDArray[np.float64], sample_period: float) -> NDArray[np.float64]:
    """Return a residual without the ripple that no model can match sample by sample.

    Parameters
    ----------
    residual
        Measured less modelled current, ``(n,)`` [A].
    sample_period
        Period of the samples [s].

    Returns
    -------
    numpy.ndarray
        The residual under a Hann window of ``BAND_S``, ``(n,)`` [A]; at the ends the window is
        cut.
    """
    length = max(1, round(BAND_S / sample_period))
    hann = np.hanning(length + 2)[1:-1]
    cover = np.convolve(np.ones(len(residual)), hann, "same")
    return np.convolve(residual, hann, "same") / cover


def rms(values: NDArray[np.float64]) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(np.square(values))))
