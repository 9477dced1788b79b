"""Zero-phase smoothing of columns by a Gaussian."""

from typing import Final

import numpy as np

from ema_core.arrays import Array

_REACH: Final = 4.0


def smoothed(columns: Array, sigma: float) -> Array:
    """Return columns smoothed by a Gaussian that is truncated at four standard deviations.

    Parameters
    ----------
    columns
        ``(n,)``, or several as rows, ``(k, n)``. Each is padded with its end values.
    sigma
        Standard deviation of the Gaussian [samples].
    """
    reach = max(1, int(_REACH * sigma + 0.5))
    places = np.arange(-reach, reach + 1)
    kernel: Array = np.exp(-0.5 * (places / max(sigma, 1e-9)) ** 2)
    kernel /= np.sum(kernel)
    rows = np.atleast_2d(columns)
    before, after = (np.repeat(ends, reach, axis=1) for ends in (rows[:, :1], rows[:, -1:]))
    padded = np.concatenate([before, rows, after], axis=1)
    smoothed: Array = np.array([np.convolve(row, kernel, mode="valid") for row in padded])
    return smoothed.reshape(columns.shape)
