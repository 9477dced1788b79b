"""How uncertain the estimates of an actuator in a given state will be (M30)."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_core.faults import ECCENTRICITY_PHASE, N_FAULTS
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.objective import Objective
from ema_monitor.identifying import identify
from ema_monitor.windows.window import Window

# The noise of the speed cancels out over a longer time than that of the current lasts.
_SPAN_S: Final = 0.04
_STEP: Final = 1e-5


class Prospect(NamedTuple):
    """What to expect of the estimates of one actuator.

    ``faults`` is its fault vector, ``(8,)``; ``estimates`` are those of the windows that stand for
    it, ``sigma`` the standard deviation that they state, root mean square, and ``scatter`` the
    standard deviation over repeated tests, ``(8,)`` each, NaN where the component is not shown.
    """

    faults: NDArray[np.float64]
    estimates: list[Estimate]
    sigma: NDArray[np.float64]
    scatter: NDArray[np.float64]

    @property
    def shown(self) -> NDArray[np.bool_]:
        """Components that every estimate gives as different from healthy, ``(8,)``."""
        return shown_by_all(self.estimates)

    def error(self, number: int) -> float:
        """Return the rms error of the estimates of one component, a phase excepted [-]."""
        errors = [one.faults[number] - self.faults[number] for one in self.estimates]
        return float(np.sqrt(np.mean(np.square(errors))))


def shown_by_all(estimates: Sequence[Estimate]) -> NDArray[np.bool_]:
    """Return which components all estimates give as different from healthy, ``(8,)``."""
    return np.all([one.valid & ~one.insignificant & ~one.unobservable for one in estimates], axis=0)


def prospect(
    windows: Sequence[Window],
    faults: NDArray[np.float64],
    description: ActuatorDescription,
    calibration: Calibration,
) -> Prospect:
    """Return what to expect of the estimates of one actuator.

    Parameters
    ----------
    windows
        Windows of it, two at least, alike but for their noise.
    faults
        Its fault vector, ``(8,)``.
    description, calibration
        As of ``identify``.
    """
    estimates = [identify(window, description, calibration, previous=faults) for window in windows]
    with np.errstate(invalid="ignore"):
        sigma = np.sqrt(np.mean([np.square(one.sigma) for one in estimates], axis=0))
    kept = shown_by_all(estimates)
    scatter = np.full(N_FAULTS, np.nan)
    if np.any(kept):
        scatter = _scatter(windows, faults, kept, calibration)
    return Prospect(faults, estimates, sigma, scatter)


def _scatter(
    windows: Sequence[Window],
    faults: NDArray[np.float64],
    kept: NDArray[np.bool_],
    calibration: Calibration,
) -> NDArray[np.float64]:
    """Return the standard deviation of the estimates over repeated tests, ``(8,)``.

    The noise is what the windows do not have in common: what the model always misses moves all
    estimates alike.

    Parameters
    ----------
    windows, faults, calibration
        As of `prospect`.
    kept
        Components that are estimated, ``(8,)``.

    Notes
    -----
    Equation M30.
    """
    objectives = [Objective(window, calibration) for window in windows]
    linear = [
        one.linearise(one.encode(faults, window.play or 0.0))
        for one, window in zip(objectives, windows, strict=True)
    ]
    common = np.mean([one.residuals for one in linear], axis=0)
    m = len(windows)
    variances = []
    for objective, at in zip(objectives, linear, strict=True):
        free = np.ones(objective.dimension, dtype=bool)
        free[:N_FAULTS] = kept
        jacobian = at.jacobian[:, free]
        weights = _turn(objective, at.point)[:, free] @ np.linalg.pinv(jacobian)
        moves = weights * (at.residuals - common)
        # Current and speed at the same time: the ripple is in both.
        moves = np.sum(np.split(moves, 2, axis=1), axis=0)
        variances.append(_long_run(moves, round(_SPAN_S / objective.spacing)) * m / (m - 1.0))
    result = np.sqrt(np.maximum(np.mean(variances, axis=0), 0.0))
    result[~kept] = math.nan
    return result


def _long_run(rows: NDArray[np.float64], lags: int) -> NDArray[np.float64]:
    """Return the variance of the sum of each row after Newey and West (1987), ``(8,)``.

    Parameters
    ----------
    rows
        Values correlated over some samples, ``(8, n)``.
    lags
        Over how many.
    """
    variance = np.sum(rows**2, axis=1)
    for lag in range(1, lags + 1):
        weight = 2.0 * (1.0 - lag / (lags + 1.0))
        variance += weight * np.sum(rows[:, lag:] * rows[:, :-lag], axis=1)
    return variance


def _turn(objective: Objective, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the derivatives of the fault vector by the components of a point, ``(8, d)``."""
    steps = _STEP * np.eye(len(point))
    (above, _), (below, _) = (objective.decode(point + sign * steps) for sign in (1.0, -1.0))
    difference = above - below
    difference[:, ECCENTRICITY_PHASE] -= np.round(difference[:, ECCENTRICITY_PHASE])
    return difference.T / (2.0 * _STEP)
