# SPDX-License-Identifier: Apache-2.0
"""Gaussian prior and posterior of the faults in a sequence of windows.

The method is described in ``docs/identification.md``, M29.
"""

from typing import Final, NamedTuple, Self

import numpy as np

from ema_core.arrays import Array
from ema_core.faults import N_FAULTS
from ema_monitor.identification.uncertainty import (
    MISMATCH_FACTOR,
    MISMATCH_SIGMA,
    SPANS,
    UNOBSERVABLE_SIGMA,
    with_mismatch,
)
from ema_monitor.optimizers.linear_model import ridge_of
from ema_monitor.windows.window import Window

NUISANCE: Final = "load_torque"
"""Hidden cause that is fitted to every stretch, because it is common in ordinary motion."""

FLOOR: Final = MISMATCH_SIGMA / SPANS
"""Minimum standard deviations due to model mismatch, in the unit box, ``(8,)``."""

_LEAST_VARIANCE = 1e-12
_FAULTS = slice(0, N_FAULTS)
_NOTHING = np.zeros((N_FAULTS, N_FAULTS))


class Knowledge(NamedTuple):
    """Gaussian distribution of the faults, in Cartesian coordinates of the unit box."""

    point: Array
    """Expected values, ``(8,)``; they may be outside the unit box."""
    covariance: Array
    """Covariance from the residuals, ``(8, 8)``."""
    shifts: Array = _NOTHING[:, :0]
    """Changes of the expected values by one standard deviation along each principal axis of the
    unit's uncertain deviations, ``(8, k)``. These deviations are the same in all windows."""
    misfit: float = 1.0
    """Ratio of the rms residual to the rms residual of a healthy window, at least 1 [-]."""
    gained: Array = _NOTHING
    """Information from the windows so far at the noise level of a healthy window, ``(8, 8)``; the
    reference for the information of a further window."""

    def rows(self) -> Array:
        """Return the Jacobian of eight residuals that represent the distribution, ``(8, 8)``.

        The residuals are independent and have unit variance.
        """
        variances, axes = np.linalg.eigh(self.covariance)
        # The standard deviation of a component does not exceed its range.
        return (axes / np.sqrt(np.clip(variances, _LEAST_VARIANCE, 1.0))).T

    @classmethod
    def of_range(cls, point: Array) -> Self:
        """Return the prior given by the fault ranges alone, centred on ``point``, ``(8,)``.

        Among equally good explanations, the explanation nearest to ``point`` is preferred.
        """
        return cls(point, np.diag((UNOBSERVABLE_SIGMA / MISMATCH_FACTOR / SPANS) ** 2))

    @property
    def sigma(self) -> Array:
        """Standard deviations including model mismatch, ``(8,)``, in the units of the faults.

        The eccentricity has two Cartesian components.
        """
        total = with_mismatch(self.covariance + self.shifts @ self.shifts.T, FLOOR)
        return SPANS * np.sqrt(np.diag(total))

    @property
    def systematic_sigma(self) -> Array:
        """Part of `sigma` that further windows cannot reduce, ``(8,)``."""
        common = MISMATCH_FACTOR**2 * self.shifts @ self.shifts.T
        return SPANS * np.sqrt(np.diag(common) + FLOOR**2)


def needs_no_evidence(window: Window, knowledge: Knowledge | None) -> set[str]:
    """Return the names of the hidden causes that are always fitted to a window.

    Measured causes are always fitted, because their errors add to the uncertainty.

    Parameters
    ----------
    window
        Test window or stretch of motion.
    knowledge
        Prior knowledge of the faults in a stretch; None for a test window.
    """
    names = {cause.name for cause in window.measured}
    return names if knowledge is None else names | {NUISANCE}


def information(jacobian: Array, noise: float) -> Array:
    """Return the Fisher information of the faults if all components are fitted, ``(8, 8)``.

    Parameters
    ----------
    jacobian
        Derivatives of the residuals, including prior residuals, ``(n, d)``.
    noise
        Variance of an effective residual.
    """
    normal = jacobian.T @ jacobian / noise
    nuisance = normal[N_FAULTS:, N_FAULTS:]
    nuisance = nuisance + ridge_of(nuisance) * np.eye(len(nuisance))
    coupling = normal[N_FAULTS:, _FAULTS]
    marginal = normal[_FAULTS, _FAULTS] - coupling.T @ np.linalg.solve(nuisance, coupling)
    return (marginal + marginal.T) / 2.0


def surprise(before: Knowledge, after: Knowledge, gained: Array) -> float:
    """Return the squared Mahalanobis distance between a window and the prior knowledge [-].

    The faults estimated from the window alone are compared with the expected faults. The covariance
    of their difference includes the model mismatch of both. For a consistent window, the distance
    is about the number of faults that the window determines.

    Parameters
    ----------
    before, after
        Knowledge of the faults before and after the window.
    gained
        Information from the window alone, ``(8, 8)``.
    """
    strengths, axes = np.linalg.eigh(gained)
    alone = (axes / np.maximum(strengths, 1.0)) @ axes.T
    rows = before.rows()
    # Converts the shift of the combined estimate to the shift of an estimate from the window alone.
    amplified = np.eye(N_FAULTS) + alone @ rows.T @ rows
    offset = amplified @ (after.point - before.point)
    common = before.shifts if before.shifts.size else np.zeros_like(after.shifts)
    shifts = amplified @ (after.shifts - common)
    covariance = before.covariance + alone + shifts @ shifts.T
    covariance = with_mismatch(covariance, np.sqrt(2.0) * FLOOR)
    return float(offset @ np.linalg.solve(covariance, offset))
