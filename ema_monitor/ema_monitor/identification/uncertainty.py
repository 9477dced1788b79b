"""Covariance and significance of the components of an estimate."""

import math
from collections.abc import Callable, Sequence
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
"""Components that are one vector, in Cartesian coordinates."""

CORRELATION_S: Final = 5e-3
"""Span over which residuals are assumed to be correlated [s]."""

UNOBSERVABLE_SIGMA: Final = 0.25
"""From this standard deviation on, a component is no better known than from its range [-]."""

_LEVEL: Final = 1.0 - 0.95 ** (1.0 / len(COMPONENTS))


def _significant_sigmas(number: int) -> float:
    if number in PLANE:
        return math.sqrt(-2.0 * math.log(_LEVEL))
    level = _LEVEL / 2.0 if FAULTS[number].is_two_sided else _LEVEL
    return NormalDist().inv_cdf(1.0 - level)


SIGNIFICANT_SIGMAS: Final = np.array([_significant_sigmas(i) for i in range(N_FAULTS)])
"""Standard deviations from healthy beyond which a component is significant, ``(8,)`` [-].

A healthy actuator shows any significant fault in one window of twenty: each of the seven faults
is tested at the level 1 - 0.95^(1/7) = 0.73 % (Sidak). The bound is one-sided for what cannot lie
below healthy (2.44), two-sided for the gain (2.68), and a circle for the eccentricity, which is a
vector in the plane (3.14, Rayleigh); its direction is significant where its amount is.
"""

SIGNIFICANT_CAUSE: Final = 3.0
"""Standard deviations beyond which a hidden cause is significant [-]."""

SMALLEST_ECCENTRICITY: Final = 0.005
"""Below this the mismatch of the model outweighs the eccentricity, and its phase is noise [-]."""

MISMATCH_FACTOR: Final = 1.45
"""By how much the mismatch of the model widens the standard deviations from the residuals:
it follows the faults, and so hides in the estimate [-]."""

WIDTHS: Final = np.array([0.5, 1.4])
"""Of two normal distributions, equally likely, that give the quantiles [standard deviations]."""

MISMATCH_SIGMA: Final = np.array([fault.mismatch for fault in FAULTS])
"""Standard deviation that the mismatch of the model adds to each component at least, ``(8,)``, with
the eccentricity in Cartesian form [-]."""

STRONG_CORRELATION: Final = 0.95
"""Correlation from which on two components cannot be told apart [-]."""

SPANS: Final = np.array([2.0 if i in PLANE else 1.0 for i in range(N_FAULTS)])
"""What one unit of a point in Cartesian coordinates of the unit box is in faults, ``(8,)`` [-]."""

USUAL_MISFIT: Final = 2.0
"""Goodness of fit up to which that factor holds; beyond, it grows with it [-]."""

GROUPS: Final = tuple(
    [i, ECCENTRICITY_PHASE] if i == ECCENTRICITY else [i]
    for i in range(N_FAULTS)
    if i != ECCENTRICITY_PHASE
)
"""Components that are healthy or not together, in Cartesian coordinates."""


class Uncertainty(NamedTuple):
    """Covariance, ``(8, 8)``, NaN where unobservable, and flags, ``(8,)``."""

    covariance: Array
    unobservable: Flags


def sandwich_covariance(
    jacobian: Array, residuals: Array, lags: int, priors: int = 0, noise: float = 0.0
) -> Array:
    """Return the covariance of a least-squares estimate under correlated residuals, ``(d, d)``.

    That is the estimator of Newey and West (1987), Econometrica 55(3), with Bartlett weights. A
    direction that leaves no trace gets a very large variance.

    Parameters
    ----------
    jacobian, residuals
        Residuals at the estimate, ``(n,)``, and their derivatives, ``(n, d)``.
    lags
        Number of samples over which they are correlated.
    priors, noise
        How many of the last rows are priors, which are independent, and the variance of each.
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
    """Return what a least-squares estimate loses by effects on the residuals, ``(d, k)``."""
    bread, _ = _inverse_normal(jacobian)
    return bread @ (jacobian.T @ effects)


def _inverse_normal(jacobian: Array) -> tuple[Array, float]:
    """Return the inverse of the normal matrix, and the ridge that it was given."""
    normal = jacobian.T @ jacobian
    ridge = ridge_of(normal)
    inverse: Array = np.linalg.inv(normal + ridge * np.eye(len(normal)))  # pyright: ignore[reportAssignmentType]
    return inverse, ridge


def with_mismatch(covariance: Array, floor: Array) -> Array:
    """Return a covariance widened by what the mismatch of the model hides from the residuals.

    ``floor`` is the standard deviation that each component has at least, ``(d,)``.
    """
    return MISMATCH_FACTOR**2 * covariance + np.diag(floor**2)


def widening(goodness_of_fit: float) -> float:
    """Return by how much a poor fit widens the standard deviations from the residuals [-]."""
    return max(1.0, goodness_of_fit / USUAL_MISFIT)


def uncertainty_of_faults(faults: Array, covariance: Array) -> Uncertainty:
    """Turn a covariance with eccentricity in Cartesian form into one of the fault vector, ``(8,)``.

    ``covariance``, ``(8, 8)`` or larger, has ``zeta cos(phi)`` and ``zeta sin(phi)`` in the places
    of eccentricity and phase.
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
    """Return what small steps in Cartesian coordinates are in a fault vector, ``(8, 8)``."""
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
    """Return which components differ from healthy, ``(d,)``, and the point without the others.

    Backward elimination on the linear model at the point: as long as some group of components
    is not significant (``SIGNIFICANT_SIGMAS``), the least significant one is set to healthy
    and the rest is fitted anew (M17). Faults are few: what a window does not show is not there.

    Parameters
    ----------
    at, healthy
        Linearisation at the estimate, and healthy point, in Cartesian coordinates of the unit box.
    covariance_of
        Returns the covariance for some columns of the Jacobian and the residuals.
    floor
        Standard deviation that the mismatch of the model adds to each coordinate, ``(d,)``.
    fitted
        Components that may differ from healthy, ``(d,)``.
    groups
        Those of them that are tested, together where they are healthy together.
    """
    shown = fitted.copy()
    groups = list(groups)
    current = at.point.copy()
    while groups:
        known = covariance_of(at.jacobian[:, shown], at.predicted(current))
        covariance = np.zeros((len(current), len(current)))
        covariance[np.ix_(shown, shown)] = with_mismatch(known, floor[shown])
        least, group = min(
            ((_distance(current - healthy, covariance, group), group) for group in groups),
            key=lambda one: one[0],
        )
        if least >= 1.0:
            break
        groups.remove(group)
        shown[group] = False
        current = refitted(at, healthy, shown)
    return shown, current


def _distance(offset: Array, covariance: Array, group: list[int]) -> float:
    """Return the squared distance from healthy over that from which it is significant."""
    part = offset[group]
    squared = part @ np.linalg.solve(covariance[np.ix_(group, group)], part)
    first = group[0]
    limit = SIGNIFICANT_SIGMAS[first] if first < N_FAULTS else SIGNIFICANT_CAUSE
    return float(squared / limit**2)
