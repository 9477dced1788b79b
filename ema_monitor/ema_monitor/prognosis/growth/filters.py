"""Growth and measurement of Gaussian filters whose estimates have errors that last.

An error e of an estimate follows an AR(1) process from test to test. As the estimate is x + e
exactly, what is known of the error of the test before is what is known of x then, so that a
scalar filter suffices: the innovation is y - x - c (y0 - x0), c being the correlation times the
ratio of the errors' sizes (Bar-Shalom, Li and Kirubarajan 2001, section 8.2.6).
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core._jit import kernel
from ema_core.growth_laws import LAWS

_EXPONENTIAL = LAWS.index("exponential")
_ARCHARD = LAWS.index("archard")
_SELF_HEATING = LAWS.index("self_heating")
_POWER = LAWS.index("power")
_LARGEST = 50.0
_LEAST_VARIANCE = 1e-14

LEAST_PROBABILITY: Final = 1e-280
"""What stands for a probability below it, so that its logarithm is finite [-]."""


@kernel()
def grown(law: int, rate: float, shape: float, x: float, hours: float) -> float:
    """Return the growth of ``ema_core.growth_laws.increment``, at most 1."""
    if law == _EXPONENTIAL:
        step = (x + shape) * math.expm1(min(rate * hours, _LARGEST))
    elif law == _ARCHARD:
        step = (1.0 / shape + x) * math.expm1(min(rate * shape * hours, _LARGEST))
    elif law == _SELF_HEATING:
        spent = rate * shape * hours * math.exp(min(shape * x, _LARGEST))
        step = -math.log1p(-spent) / shape if spent < 1.0 else 1.0
    elif law == _POWER:
        step = (x ** (1.0 / shape) + hours / rate) ** shape - x
    else:
        step = rate * hours
    return min(step, 1.0)


@kernel()
def grow_cells(
    law: NDArray[np.intp],
    side: NDArray[np.float64],
    rate: NDArray[np.float64],
    shape: NDArray[np.float64],
    mean: NDArray[np.float64],
    variance: NDArray[np.float64],
    slope: NDArray[np.float64],
    hours: NDArray[np.float64],
    noise_hours: float,
) -> None:
    """Let the levels of cells grow in place, at two sigma points each.

    Parameters
    ----------
    law
        Number of the law of each cell in ``LAWS``, ``(n,)``.
    side, rate, shape
        As of ``Cells``.
    mean, variance
        Signed distance from healthy [-], ``(n,)``.
    slope
        Derivative of the level after by that before, ``(n,)``; written.
    hours
        Hours of growth, ``(n,)`` [h]; where they are 0 nothing changes.
    noise_hours
        Variance of the effective time of growth per hour [h].
    """
    for i in range(mean.size):
        u = hours[i]
        if u <= 0.0:
            continue
        x, sd = side[i] * mean[i], math.sqrt(variance[i])
        low, high = max(x - sd, 0.0), max(x + sd, 0.0)
        least = grown(law[i], rate[i], shape[i], low, u)
        most = grown(law[i], rate[i], shape[i], high, u)
        spread = 0.5 * (high + most - low - least)
        step = 0.5 * (least + most)
        slope[i] = spread / sd if sd > 0.0 else 1.0
        mean[i] = side[i] * 0.5 * (low + least + high + most)
        variance[i] = spread * spread + step * step * noise_hours / u


@kernel()
def change_cells(
    weight: NDArray[np.float64],
    mean: NDArray[np.float64],
    variance: NDArray[np.float64],
    component: NDArray[np.intp],
    leaving: NDArray[np.float64],
    arriving: NDArray[np.float64],
    n: int,
) -> None:
    """Move probability from cell to cell of each component, in place, merging what arrives.

    Parameters
    ----------
    weight, mean, variance, component
        Of all cells, ``(m,)``.
    leaving
        Probability of leaving each, ``(m,)``.
    arriving
        Share of what leaves a component's cells that arrives at each, ``(m,)``.
    n
        Number of components.
    """
    mass, first, second = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(weight.size):
        k, out = component[i], leaving[i] * weight[i]
        mass[k] += out
        first[k] += out * mean[i]
        second[k] += out * (variance[i] + mean[i] * mean[i])
        weight[i] -= out
    for k in range(n):
        mass[k] = max(mass[k], LEAST_PROBABILITY)
        first[k] /= mass[k]
        second[k] = max(second[k] / mass[k] - first[k] * first[k], 0.0)
    for i in range(weight.size):
        k = component[i]
        new = arriving[i] * mass[k]
        total = max(weight[i] + new, LEAST_PROBABILITY)
        share, gap = new / total, first[k] - mean[i]
        mean[i] += share * gap
        variance[i] += share * (second[k] - variance[i]) + share * (1.0 - share) * gap * gap
        weight[i] = total


@kernel()
def temper(
    weight: NDArray[np.float64],
    prior: NDArray[np.float64],
    component: NDArray[np.intp],
    power: NDArray[np.float64],
) -> None:
    """Draw weights towards their prior, in place: each to a power of its component."""
    for i in range(weight.size):
        kept = power[component[i]]
        if kept < 1.0 and prior[i] > 0.0:
            weight[i] = prior[i] * math.exp(
                kept * math.log(max(weight[i], LEAST_PROBABILITY) / prior[i])
            )


@kernel()
def _below(innovation: float, variance: float) -> float:
    """Return the probability of a smaller innovation."""
    return 0.5 * math.erfc(-innovation / math.sqrt(2.0 * variance))


@kernel()
def measure_cells(
    at: NDArray[np.intp],
    component: NDArray[np.intp],
    mean: NDArray[np.float64],
    variance: NDArray[np.float64],
    slope: NDArray[np.float64],
    mean_before: NDArray[np.float64],
    variance_before: NDArray[np.float64],
    value: NDArray[np.float64],
    fresh: NDArray[np.float64],
    carried: NDArray[np.float64],
    value_before: NDArray[np.float64],
    large: float,
    rare: float,
    log_likelihood: NDArray[np.float64],
    below: NDArray[np.float64],
) -> None:
    """Update cells by values with occasional errors, in place: two Gaussians, merged.

    Parameters
    ----------
    at
        Numbers of the cells, ``(m,)``.
    component, mean, variance, slope
        Of all cells, ``(n,)``.
    mean_before, variance_before
        At the test before, ``(n,)``.
    value, fresh
        Value of each component and the variance of the part of its error that is new, ``(7,)``.
    carried, value_before
        Factor c of the error of the test before, and its value, ``(7,)``.
    large, rare
        Standard deviation and probability of an occasional error [-].
    log_likelihood, below
        Of each cell, and the probability of a smaller value by it, ``(n,)``; written at ``at``.
    """
    for i in at:
        k = component[i]
        c = carried[k]
        # Merged, the two variances need not fit the slope any longer.
        joint = min(slope[i] * variance_before[i], math.sqrt(variance[i] * variance_before[i]))
        innovation = value[k] - mean[i] - c * (value_before[k] - mean_before[i])
        shared = variance[i] - c * joint
        usual = variance[i] - 2.0 * c * joint + c * c * variance_before[i] + fresh[k]
        wide = usual + large * large
        squared = innovation * innovation
        log_usual = math.log1p(-rare) - 0.5 * (squared / usual + math.log(usual))
        log_wide = math.log(max(rare, LEAST_PROBABILITY)) - 0.5 * (squared / wide + math.log(wide))
        high = max(log_usual, log_wide)
        log_p = high + math.log(math.exp(log_usual - high) + math.exp(log_wide - high))
        share = math.exp(log_wide - log_p)
        gain_usual, gain_wide = shared / usual, shared / wide
        gain = gain_usual + share * (gain_wide - gain_usual)
        spread = share * (1.0 - share) * (gain_usual - gain_wide) ** 2 * squared
        mean[i] += gain * innovation
        variance[i] = max(variance[i] - gain * shared + spread, _LEAST_VARIANCE)
        log_likelihood[i] = log_p
        below[i] = (1.0 - rare) * _below(innovation, usual) + rare * _below(innovation, wide)


@kernel()
def probabilities_below(
    innovation: NDArray[np.float64],
    usual: NDArray[np.float64],
    wide: NDArray[np.float64],
    rare: float,
    below: NDArray[np.float64],
) -> None:
    """Write the probabilities of smaller innovations than some, all flat, by two Gaussians.

    Parameters
    ----------
    innovation, usual, wide
        The innovations and the variances of both, ``(n,)``.
    rare
        Probability of the wide one [-].
    below
        Of each, ``(n,)``.
    """
    for i in range(innovation.size):
        part = rare * _below(innovation[i], wide[i])
        below[i] = (1.0 - rare) * _below(innovation[i], usual[i]) + part
