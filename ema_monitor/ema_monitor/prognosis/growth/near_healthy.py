"""Update by an estimate that was set to healthy: the fault is small, not exactly none."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core._jit import kernel

_TAIL: Final = -6.0
_ROOT_2: Final = math.sqrt(2.0)
_ROOT_2_PI: Final = math.sqrt(2.0 * math.pi)


@kernel()
def near_healthy_update(
    mean: NDArray[np.float64],
    variance: NDArray[np.float64],
    noise: NDArray[np.float64],
    reach: NDArray[np.float64],
    two_sided: NDArray[np.bool_],
    log_likelihood: NDArray[np.float64],
) -> None:
    """Update Gaussians in place, knowing that x + error is not significant.

    Parameters
    ----------
    mean, variance
        Distance from healthy before, ``(n,)``; after it on return.
    noise
        Variance of the error, ``(n,)``.
    reach
        Standard deviations of the error within which it is not, ``(n,)`` [-].
    two_sided
        Whether the component may lie on either side of healthy, ``(n,)``.
    log_likelihood
        Logarithm of the probability of this, ``(n,)``; written.

    Notes
    -----
    Moments of a Gaussian under a probit likelihood: Rasmussen and Williams, Gaussian Processes
    for Machine Learning, 2006, section 3.9. Far in the tail the probit is a Gaussian at its edge.
    """
    for i in range(mean.size):
        m, sigma = mean[i], math.sqrt(noise[i])
        sign = 1.0
        if two_sided[i] and m < 0.0:
            sign = -1.0
        m *= sign
        total = variance[i] + noise[i]
        root = math.sqrt(total)
        gain = variance[i] / total
        upper = (reach[i] * sigma - m) / root
        if upper < _TAIL:
            mean[i] = sign * (m + gain * upper * root)
            variance[i] *= 1.0 - gain
            # Mills' ratio joins both forms where they meet.
            log_likelihood[i] = -0.5 * upper * upper - math.log(-upper * _ROOT_2_PI)
            continue
        mass = 0.5 * math.erfc(-upper / _ROOT_2)
        density = math.exp(-0.5 * upper * upper) / _ROOT_2_PI
        slope, bend = -density, -upper * density
        if two_sided[i]:
            lower = (-reach[i] * sigma - m) / root
            mass -= 0.5 * math.erfc(-lower / _ROOT_2)
            edge = math.exp(-0.5 * lower * lower) / _ROOT_2_PI
            slope += edge
            bend += lower * edge
        ratio = slope / mass
        mean[i] = sign * (m + gain * root * ratio)
        variance[i] *= 1.0 + gain * (bend / mass - ratio * ratio)
        log_likelihood[i] = math.log(mass)
