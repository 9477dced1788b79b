# SPDX-License-Identifier: Apache-2.0
"""The minimum of a bounded least-squares problem, proved without a solver."""

import numpy as np
from numpy.typing import NDArray


def bounded_minimum(
    matrix: NDArray[np.float64], right: NDArray[np.float64], point: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the minimum in the unit box; its walls are those of the point.

    The problem is convex: a point where the gradient is zero off the walls, and points outward at
    them, is the minimum. An AssertionError says that the point is at other walls than the minimum.
    """
    free = (point > 0.0) & (point < 1.0)
    best = point.copy()
    best[free] = np.linalg.lstsq(matrix[:, free], right - matrix[:, ~free] @ point[~free])[0]
    gradient = matrix.T @ (matrix @ best - right)
    rounding = 1e-10 * np.sum(matrix**2)
    assert np.all((best >= -1e-12) & (best <= 1.0 + 1e-12))
    assert np.all(gradient[point == 0.0] >= -rounding)
    assert np.all(gradient[point == 1.0] <= rounding)
    return best
