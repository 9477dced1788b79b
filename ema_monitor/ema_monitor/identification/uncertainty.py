# SPDX-License-Identifier: Apache-2.0
"""Covariance and significance of the components of an estimate."""

import math
from collections.abc import Callable, Sequence
from operator import itemgetter
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.faults import (
    COMPONENTS,
    ECCENTRICITY,
    ECCENTRICITY_PHASE,
    FAULTS,
    N_FAULTS,
    eccentricity_angle,
    eccentricity_vector,
)
from ema_monitor.optimizers.linear_model import Linearisation, refitted, ridge_of

PLANE: Final = [ECCENTRICITY, ECCENTRICITY_PHASE]
"""Components that form a vector in Cartesian coordinates: the eccentricity."""

CORRELATION_S: Final = 5e-3
"""Time over which residuals are assumed to be correlated [s]."""

UNOBSERVABLE_SIGMA: Final = 0.25
"""Standard deviation above which a component counts as unobservable [-]."""

_LEVEL: Final = 1.0 - 0.95 ** (1.0 / len(COMPONENTS))


def _significant_sigmas(number: int) -> float:
    if number in PLANE:
        return math.sqrt(-2.0 * math.log(_LEVEL))
    level = _LEVEL / 2.0 if FAULTS[number].is_two_sided else _LEVEL
    return NormalDist().inv_cdf(1.0 - level)


SIGNIFICANT_SIGMAS: Final = np.array([_significant_sigmas(i) for i in range(N_FAULTS)])
"""Standard deviations from healthy beyond which a component is significant, ``(8,)`` [-].

A healthy actuator has a significant fault in 1 of 20 windows: each of the seven faults is tested at
the level 1 - 0.95^(1/7) = 0.73 % (Sidak). The bound is one-sided for faults that cannot be below
healthy (2.44), two-sided for the gain (2.68), and a circle for the eccentricity vector (3.14,
Rayleigh). The direction of the eccentricity is significant if its magnitude is.
"""

SIGNIFICANT_CAUSE: Final = 3.0
"""Standard deviations beyond which a hidden cause is significant [-]."""

SMALLEST_ECCENTRICITY: Final = 0.005
"""Smallest meaningful eccentricity; below, model mismatch dominates and the phase is noise [-]."""

MISMATCH_FACTOR: Final = 1.45
"""Factor applied to the residual-based standard deviations to cover model mismatch [-].

The mismatch depends on the faults, so that part of it biases the estimate instead of the residuals.
"""

WIDTHS: Final = np.array([0.5, 1.4])
"""Widths of the two equally likely normal distributions behind the quantiles [sigma]."""

MISMATCH_SIGMA: Final = np.array([fault.mismatch for fault in FAULTS])
"""Minimum standard deviation of each component due to model mismatch, ``(8,)``, with Cartesian
eccentricity [-]."""

STRONG_CORRELATION: Final = 0.95
"""Correlation above which two components cannot be distinguished [-]."""

SPANS: Final = np.array([2.0 if i in PLANE else 1.0 for i in range(N_FAULTS)])
"""Scale factors from Cartesian coordinates in the unit box to faults, ``(8,)`` [-]."""

USUAL_MISFIT: Final = 2.0
"""Goodness of fit up to which `MISMATCH_FACTOR` applies; above it the factor grows [-]."""

GROUPS: Final = tuple(
    [i, ECCENTRICITY_PHASE] if i == ECCENTRICITY else [i]
    for i in range(N_FAULTS)
    if i != ECCENTRICITY_PHASE
)
"""Groups of components that are healthy together, in Cartesian coordinates."""


class Uncertainty(NamedTuple):
    """Uncertainty of a fault vector."""

    covariance: Array
    """Covariance, ``(8, 8)``; NaN in rows and columns of unobservable components."""
    unobservable: Flags
    """Flags of the components that the window does not determine, ``(8,)``."""


def sandwich_covariance(
    jacobian: Array, residuals: Array, lags: int, priors: int = 0, noise: float = 0.0
) -> Array:
    """Return the covariance of a least-squares estimate under correlated residuals, ``(d, d)``.

    This is the estimator of Newey and West (1987), Econometrica 55(3), with Bartlett weights. A
    direction without effect on the residuals gets a very large variance.

    Parameters
    ----------
    jacobian, residuals
        Derivatives of the residuals at the estimate, ``(n, d)``, and the residuals, ``(n,)``.
    lags
        Number of samples over which the residuals are correlated.
    priors, noise
        Number of prior residuals, which are independent and come last, and their variance.
    """
    n = len(residuals) - priors
    prior = jacobian[n:]
    scores = jacobian[:n] * residuals[:n, None]
    centre = scores.T @ scores + noise * (prior.T @ prior)
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        centre += (1.0 - lag / (lags + 1.0)) * (product + product.T)
    bread, ridge = _inverse_normal(jacobian)
    covariance = bread @ (centre + ridge * np.eye(len(bread))) @ bread
    return (covariance + covariance.T) / 2.0


def shifts_of(jacobian: Array, effects: Array) -> Array:
    """Return the decrease of a least-squares estimate due to added residuals, ``(d, k)``.

    Parameters
    ----------
    jacobian
        Derivatives of the residuals, ``(n, d)``.
    effects
        Values added to the residuals, ``(n, k)``.
    """
    bread, _ = _inverse_normal(jacobian)
    return bread @ (jacobian.T @ effects)


def _inverse_normal(jacobian: Array) -> tuple[Array, float]:
    """Return the inverse of the normal matrix after adding a ridge, and the ridge."""
    normal = jacobian.T @ jacobian
    ridge = ridge_of(normal)
    inverse: Array = np.linalg.inv(normal + ridge * np.eye(len(normal)))  # pyright: ignore[reportAssignmentType]
    return inverse, ridge


def with_mismatch(covariance: Array, floor: Array) -> Array:
    """Return a covariance increased to cover model mismatch.

    ``floor`` is the smallest standard deviation of each component, ``(d,)``.
    """
    return MISMATCH_FACTOR**2 * covariance + np.diag(floor**2)


def widening(goodness_of_fit: float) -> float:
    """Return the factor by which a poor fit increases the standard deviations [-]."""
    return max(1.0, goodness_of_fit / USUAL_MISFIT)


def uncertainty_of_faults(faults: Array, covariance: Array) -> Uncertainty:
    """Return the uncertainty of a fault vector from a covariance in Cartesian coordinates.

    Parameters
    ----------
    faults
        Fault vector, ``(8,)``.
    covariance
        Covariance, ``(8, 8)`` or larger, of ``zeta cos(phi)`` and ``zeta sin(phi)`` in place of
        eccentricity and phase. It does not include model mismatch, which is added here.
    """
    covariance = with_mismatch(covariance[:N_FAULTS, :N_FAULTS], MISMATCH_SIGMA)
    plane = covariance[np.ix_(PLANE, PLANE)]
    zeta, offset = faults[ECCENTRICITY], eccentricity_vector(faults)
    distance = float(offset @ np.linalg.solve(plane, offset))
    detected = distance > SIGNIFICANT_SIGMAS[ECCENTRICITY] ** 2 and zeta > SMALLEST_ECCENTRICITY

    turn = turn_of(faults)
    result = turn @ covariance @ turn.T
    unobservable = ~(np.sqrt(np.diag(result)) <= UNOBSERVABLE_SIGMA)
    unobservable[ECCENTRICITY_PHASE] |= not detected
    result[unobservable, :] = np.nan
    result[:, unobservable] = np.nan
    return Uncertainty(result, unobservable)


def turn_of(faults: Array) -> Array:
    """Return the Jacobian of a fault vector with respect to Cartesian coordinates, ``(8, 8)``.

    The derivative of the phase is computed for an eccentricity of at least
    ``SMALLEST_ECCENTRICITY``, because it is infinite at 0.
    """
    phi = eccentricity_angle(faults[ECCENTRICITY_PHASE])
    cosine, sine = np.cos(phi), np.sin(phi)
    around = 2.0 * np.pi * max(faults[ECCENTRICITY], SMALLEST_ECCENTRICITY)
    turn = np.eye(N_FAULTS)
    turn[np.ix_(PLANE, PLANE)] = [[cosine, sine], [-sine / around, cosine / around]]
    return turn


def significant_components(
    at: Linearisation,
    healthy: Array,
    covariance_of: Callable[[Array, Array], Array],
    floor: Array,
    fitted: Flags,
    groups: Sequence[list[int]],
) -> tuple[Flags, Array]:
    """Return flags of the significant components, ``(d,)``, and the optimum restricted to them.

    Backward elimination on the linear model: as long as a group of components is not significant,
    the least significant group is set to healthy and the remaining components are fitted again. The
    limit is ``SIGNIFICANT_SIGMAS`` for a fault, and ``SIGNIFICANT_CAUSE`` for a hidden cause.
    Faults are rare: a fault without evidence counts as absent. See M17 in
    ``docs/identification.md``.

    Parameters
    ----------
    at, healthy
        Linearisation at the estimate, and healthy point, in Cartesian coordinates of the unit box.
    covariance_of
        Function that returns the covariance from columns of the Jacobian and the residuals.
    floor
        Smallest standard deviation of each coordinate due to model mismatch, ``(d,)``.
    fitted
        Flags of the components that may differ from healthy, ``(d,)``.
    groups
        Groups of fitted components. The components of a group are tested together.
    """
    shown = fitted.copy()
    groups = list(groups)
    current = at.point.copy()
    while groups:
        fitted_covariance = covariance_of(at.jacobian[:, shown], at.predicted(current))
        covariance = np.zeros((len(current), len(current)))
        covariance[np.ix_(shown, shown)] = with_mismatch(fitted_covariance, floor[shown])
        least, group = min(
            ((_distance(current - healthy, covariance, group), group) for group in groups),
            key=itemgetter(0),
        )
        if least >= 1.0:
            break
        groups.remove(group)
        shown[group] = False
        current = refitted(at, healthy, shown)
    return shown, current


def _distance(offset: Array, covariance: Array, group: list[int]) -> float:
    """Return the squared distance from healthy, relative to the squared limit of significance."""
    part = offset[group]
    squared = part @ np.linalg.solve(covariance[np.ix_(group, group)], part)
    first = group[0]
    limit = SIGNIFICANT_SIGMAS[first] if first < N_FAULTS else SIGNIFICANT_CAUSE
    return float(squared / limit**2)
