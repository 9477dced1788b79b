# SPDX-License-Identifier: Apache-2.0
"""Zero-phase smoothing of columns by a Gaussian."""

from typing import Final

import numpy as np

from ema_core.arrays import Array

_REACH: Final = 4.0


def smoothed(columns: Array, sigma: float) -> Array:
    """Return columns smoothed by a Gaussian truncated at four standard deviations.

    Parameters
    ----------
    columns
        One column, ``(n,)``, or several columns as rows, ``(k, n)``. Each column is padded with its
        end values.
    sigma
        Standard deviation of the Gaussian [samples].
    """
    reach = max(1, int(_REACH * sigma + 0.5))
    offsets = np.arange(-reach, reach + 1)
    kernel: Array = np.exp(-0.5 * (offsets / max(sigma, 1e-9)) ** 2)
    kernel /= np.sum(kernel)
    rows = np.atleast_2d(columns)
    before, after = (np.repeat(ends, reach, axis=1) for ends in (rows[:, :1], rows[:, -1:]))
    padded = np.concatenate([before, rows, after], axis=1)
    result: Array = np.array([np.convolve(row, kernel, mode="valid") for row in padded])
    return result.reshape(columns.shape)
