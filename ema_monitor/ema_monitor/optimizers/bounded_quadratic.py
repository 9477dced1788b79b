"""The lowest point of a convex quadratic within the unit box."""

import numpy as np
from numpy.typing import NDArray


def lowest_in_box(
    hessian: NDArray[np.float64], gradient: NDArray[np.float64], start: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Minimise ``g (x - start) + (x - start) H (x - start) / 2`` over the unit box.

    Primal active set: go to the minimum over the free components until a bound is in the way,
    hold what is there, and let go of the held component that would descend most. The Hessian,
    ``(d, d)``, is positive definite; the gradient is that at the start, ``(d,)``.
    """
    d = len(start)
    x = start.copy()
    held = np.zeros(d, dtype=bool)
    # Each round settles a face of the box; far fewer are needed than this guard allows.
    for _ in range(10 * d):
        slope = gradient + hessian @ (x - start)
        move = np.zeros(d)
        free = ~held
        move[free] = np.linalg.solve(hessian[np.ix_(free, free)], -slope[free])
        distance = np.where(move > 0.0, 1.0 - x, x)
        share = np.divide(distance, np.abs(move), out=np.full(d, np.inf), where=move != 0.0)
        reach = min(1.0, np.min(share))
        x = np.clip(x + reach * move, 0.0, 1.0)
        if reach < 1.0:
            stopped = share <= reach
            x[stopped] = move[stopped] > 0.0
            held |= stopped
            continue
        slope = gradient + hessian @ (x - start)
        descent = np.where(held, np.where(x == 0.0, -slope, slope), 0.0)
        steepest = int(np.argmax(descent))
        if descent[steepest] <= 1e-14 * np.max(np.abs(gradient)):
            break
        held[steepest] = False
    return x
