"""Which components of an estimate the window really shows to differ from healthy."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, N_FAULTS
from ema_monitor.identification.uncertainty import (
    SIGNIFICANT_SIGMAS,
    sandwich_covariance,
    with_mismatch,
)
from ema_monitor.optimizers.bounded_quadratic import lowest_in_box

GROUPS: Final = tuple(
    [i, ECCENTRICITY_PHASE] if i == ECCENTRICITY else [i]
    for i in range(N_FAULTS)
    if i != ECCENTRICITY_PHASE
)
"""Components that are healthy or not together, in Cartesian coordinates."""


def significant_components(
    point: NDArray[np.float64],
    healthy: NDArray[np.float64],
    residuals: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    lags: int,
    floor: NDArray[np.float64],
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return which components differ from healthy, ``(d,)``, and the point without the others.

    Backward elimination on the linear model at the point: as long as some group of components
    is not significant (``SIGNIFICANT_SIGMAS``), the least significant one is put back to healthy
    and the rest is fitted anew. Faults are few: what a window does not show is not there (M17).

    Parameters
    ----------
    point, healthy
        Estimate and healthy point in Cartesian coordinates of the unit box, ``(d,)``.
    residuals
        Residuals at the estimate, ``(n,)``.
    jacobian
        Their derivatives, ``(n, d)``.
    lags
        Number of residuals over which they are correlated.
    floor
        Standard deviation that the mismatch of the model adds to each coordinate, ``(d,)``.
    """
    shown = np.ones(len(point), dtype=bool)
    groups = list(GROUPS)
    current = point.copy()
    while groups:
        left = residuals + jacobian @ (current - point)
        known = sandwich_covariance(jacobian[:, shown], left, lags)
        covariance = np.zeros((len(point), len(point)))
        covariance[np.ix_(shown, shown)] = with_mismatch(known, floor[shown])
        least, group = min(
            ((_distance(current - healthy, covariance, group), group) for group in groups),
            key=lambda one: one[0],
        )
        if least >= 1.0:
            break
        groups.remove(group)
        shown[group] = False
        current = refitted(point, healthy, residuals, jacobian, shown)
    return shown, current


def refitted(
    point: NDArray[np.float64],
    healthy: NDArray[np.float64],
    residuals: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    shown: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return the lowest point, ``(d,)``, of the linear model with the other components healthy.

    Parameters
    ----------
    point, healthy, residuals, jacobian
        As of `significant_components`.
    shown
        Components to fit, ``(d,)``.
    """
    start = np.where(shown, point, healthy)
    left = residuals + jacobian @ (start - point)
    columns = jacobian[:, shown]
    normal = columns.T @ columns
    # A ridge keeps a component solvable that leaves no trace.
    normal += 1e-9 * max(np.max(np.diag(normal), initial=0.0), 1e-200) * np.eye(len(normal))
    start[shown] = lowest_in_box(normal, columns.T @ left, start[shown])
    return start


def _distance(
    offset: NDArray[np.float64], covariance: NDArray[np.float64], group: list[int]
) -> float:
    """Return the squared distance from healthy over that from which it is significant."""
    part = offset[group]
    squared = part @ np.linalg.solve(covariance[np.ix_(group, group)], part)
    return float(squared / SIGNIFICANT_SIGMAS[group[0]] ** 2)
