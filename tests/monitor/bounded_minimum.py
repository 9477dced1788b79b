# SPDX-License-Identifier: Apache-2.0
"""The minimum of a bounded least-squares problem, verified without a solver."""

import numpy as np
from numpy.typing import NDArray


def bounded_minimum(
    matrix: NDArray[np.float64], right: NDArray[np.float64], point: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the minimum in the unit box, assuming that it touches the same bounds as ``point``.

    The problem is convex: a point is the minimum if the gradient vanishes for components off the
    bounds and points outward at the bounds. Otherwise an AssertionError is raised.
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
