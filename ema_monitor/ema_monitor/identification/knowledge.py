"""What is known of the faults before and after a window, as a Gaussian (M29)."""

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
"""The hidden cause that is usual in ordinary motion: fitted to every stretch, without evidence."""

FLOOR: Final = MISMATCH_SIGMA / SPANS
"""What the mismatch of the model adds to each fault at least, in the unit box, ``(8,)``."""

_LEAST_VARIANCE = 1e-12
_FAULTS = slice(0, N_FAULTS)
_NOTHING = np.zeros((N_FAULTS, N_FAULTS))


class Knowledge(NamedTuple):
    """What is known of the faults, in Cartesian coordinates of the unit box.

    Attributes
    ----------
    point
        Expected values, ``(8,)``; they may be outside of the box.
    covariance
        Their covariance as the residuals tell it, ``(8, 8)``.
    shifts
        What one standard deviation along each principal axis of what is not known of the unit
        changes them by, ``(8, k)``. It is common to all windows.
    misfit
        How many times larger than when healthy the residuals are that go with it, at least 1.
    gained
        Information that the windows would have given with the noise of a healthy one, ``(8, 8)``:
        what one tells more is judged by it.
    """

    point: Array
    covariance: Array
    shifts: Array = _NOTHING[:, :0]
    misfit: float = 1.0
    gained: Array = _NOTHING

    def rows(self) -> Array:
        """Return the derivatives of eight independent residuals of unit variance, ``(8, 8)``."""
        variances, axes = np.linalg.eigh(self.covariance)
        # Beyond its range nothing is known of a component.
        return (axes / np.sqrt(np.clip(variances, _LEAST_VARIANCE, 1.0))).T

    @classmethod
    def of_range(cls, point: Array) -> Self:
        """Return that a fault is no better known than from its range.

        Of two explanations that fit as well, the one near ``point``, ``(8,)``, is taken.
        """
        return cls(point, np.diag((UNOBSERVABLE_SIGMA / MISMATCH_FACTOR / SPANS) ** 2))

    @property
    def sigma(self) -> Array:
        """Standard deviations with the mismatch of the model, ``(8,)``, in units of the faults.

        Those of the eccentricity are the two of its plane.
        """
        total = with_mismatch(self.covariance + self.shifts @ self.shifts.T, FLOOR)
        return SPANS * np.sqrt(np.diag(total))

    @property
    def systematic_sigma(self) -> Array:
        """The part of `sigma` that further windows do not lower, ``(8,)``."""
        common = MISMATCH_FACTOR**2 * self.shifts @ self.shifts.T
        return SPANS * np.sqrt(np.diag(common) + FLOOR**2)


def needs_no_evidence(window: Window, known: Knowledge | None) -> set[str]:
    """Return the names of the hidden causes that are components of any fit of a window.

    What was measured is one of them: its error is part of the uncertainty.
    """
    names = {one.name for one in window.measured}
    return names if known is None else names | {NUISANCE}


def information(jacobian: Array, noise: float) -> Array:
    """Return the information on the faults, ``(8, 8)``, the other components being fitted, too.

    Parameters
    ----------
    jacobian
        Derivatives of the residuals, those of priors included, ``(n, d)``.
    noise
        Variance of an effective residual.
    """
    normal = jacobian.T @ jacobian / noise
    others = normal[N_FAULTS:, N_FAULTS:]
    others = others + ridge_of(others) * np.eye(len(others))
    coupling = normal[N_FAULTS:, _FAULTS]
    found = normal[_FAULTS, _FAULTS] - coupling.T @ np.linalg.solve(others, coupling)
    return (found + found.T) / 2.0


def surprise(known: Knowledge, after: Knowledge, gained: Array) -> float:
    """Return the squared distance of a window from what was known before it.

    It is that of the faults that the window alone, with its information ``gained``, would give from
    those expected, over its covariance with the mismatch of both; where it agrees, about the number
    of faults it shows.
    """
    strengths, axes = np.linalg.eigh(gained)
    alone = (axes / np.maximum(strengths, 1.0)) @ axes.T
    rows = known.rows()
    # From what the window has moved the estimate by to where it would be with the window alone.
    amplified = np.eye(N_FAULTS) + alone @ rows.T @ rows
    offset = amplified @ (after.point - known.point)
    common = known.shifts if known.shifts.size else np.zeros_like(after.shifts)
    shifts = amplified @ (after.shifts - common)
    covariance = known.covariance + alone + shifts @ shifts.T
    covariance = with_mismatch(covariance, np.sqrt(2.0) * FLOOR)
    return float(offset @ np.linalg.solve(covariance, offset))
