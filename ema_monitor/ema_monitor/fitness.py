"""How far a model's current is from the measured one, as a row of weighted residuals.

The cost is the sum of the squares of the row, so that one row serves algorithms that want a cost
and algorithms that want residuals.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray


def total_least_squares_weights(
    measured: NDArray[np.float64], sample_period: float
) -> NDArray[np.float64]:
    """Return the weights of total least squares: distance normal to the measured curve.

    Parameters
    ----------
    measured
        Measured current, ``(n,)`` [A].
    sample_period
        Period of the samples [s].

    Returns
    -------
    numpy.ndarray
        Factors of the difference in current, ``(n,)`` [s^(1/2)]; the cost is in A^2.s.

    Notes
    -----
    Equation M13; eq. 6.6 of the thesis with the slope over its root mean square.
    """
    slope = np.gradient(measured, sample_period)
    rms = np.sqrt(np.mean(slope**2))
    relative = slope / rms if rms > 0.0 else slope
    return np.sqrt(sample_period / np.sqrt(relative**2 + 1.0))


def least_squares_weights(
    measured: NDArray[np.float64], sample_period: float
) -> NDArray[np.float64]:
    """Return the weights of plain least squares (eq. 6.3 of the thesis times the period).

    Parameters
    ----------
    measured
        Measured current, ``(n,)`` [A].
    sample_period
        Period of the samples [s].
    """
    return np.full(len(measured), np.sqrt(sample_period))


WEIGHTS: Final = {
    "total_least_squares": total_least_squares_weights,
    "least_squares": least_squares_weights,
}
"""Fitness functions by name."""
