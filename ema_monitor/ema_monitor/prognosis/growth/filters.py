# SPDX-License-Identifier: Apache-2.0
"""Updates of Gaussian filters that are robust to occasional large errors."""

import math
from typing import Final, NamedTuple

import numpy as np

from ema_core._jit import kernel
from ema_core.arrays import Array, Flags
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings

LEAST_PROBABILITY: Final = 1e-280
"""Lower bound of probabilities, to keep logarithms finite [-]."""

_TAIL: Final = -6.0
_ROOT_2: Final = math.sqrt(2.0)
_ROOT_2_PI: Final = math.sqrt(2.0 * math.pi)


class Correction(NamedTuple):
    """State update from a two-component Gaussian mixture, merged into one Gaussian."""

    log_likelihood: Array
    """Log-likelihood of the innovation, up to a constant."""
    gain: Array
    """Change of the mean per innovation and per covariance of state and innovation."""
    shrinking: Array
    """Decrease of the covariance per squared covariance of state and innovation."""
    below: Array
    """Predicted probability of a smaller innovation [-]."""


def corrected(innovation: Array, usual: Array, settings: TrackerSettings) -> Correction:
    """Return the state updates for innovations whose noise has occasional large errors.

    ``usual`` is the variance of the innovations without a large error.
    """
    rare, squared = settings.occasional_probability, innovation**2
    wide = usual + settings.occasional_error**2
    log_usual = math.log1p(-rare) - 0.5 * (squared / usual + np.log(usual))
    log_wide = math.log(max(rare, LEAST_PROBABILITY)) - 0.5 * (squared / wide + np.log(wide))
    log_p = np.logaddexp(log_usual, log_wide)
    share, gap = np.exp(log_wide - log_p), 1.0 / wide - 1.0 / usual
    gain = 1.0 / usual + share * gap
    below = np.zeros(innovation.shape)
    _below((innovation / np.sqrt(usual)).ravel(), 1.0 - rare, below.ravel())
    _below((innovation / np.sqrt(wide)).ravel(), rare, below.ravel())
    return Correction(log_p, gain, gain - share * (1.0 - share) * gap**2 * squared, below)


@kernel()
def _below(away: Array, share: float, total: Array) -> None:
    """Add ``share`` times the standard normal CDF at ``away`` to ``total``, in place."""
    for i in range(away.size):
        total[i] += share * 0.5 * math.erfc(-away[i] / _ROOT_2)


@kernel()
def near_healthy_update(
    mean: Array,
    variance: Array,
    noise: Array,
    reach: Array,
    two_sided: Flags,
    log_likelihood: Array,
) -> None:
    """Update Gaussians in place, ``(n,)``, given that the estimate was set to healthy.

    ``log_likelihood`` is overwritten with the log-likelihood of this observation.

    The value plus an error of variance ``noise`` then lies at most ``reach`` standard deviations of
    the error above healthy, or within this distance on either side where ``two_sided``. The moments
    follow from a Gaussian prior with a probit likelihood (Rasmussen and Williams, Gaussian
    Processes for Machine Learning, 2006, section 3.9). Far in the tail, the probit is approximated
    by a Gaussian at its edge.
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
            # Mills' ratio makes both forms continuous.
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
