"""What one valid test told of the faults, and at which service hour."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import N_FAULTS, healthy_faults
from ema_monitor.estimate import Estimate


@dataclass(frozen=True, eq=False)
class Observation:
    """What one valid test told.

    Attributes
    ----------
    hours
        Service hour of the test [h].
    faults
        Fault vector found, ``(8,)``.
    covariance
        Its covariance, ``(8, 8)``; rows and columns of unobservable components are not read.
    unobservable
        Components that the test says nothing useful about, ``(8,)``.
    stamp_ns
        Stamp of the test [ns].

    Raises
    ------
    ValueError
        When the hours are no number of at least 0, a shape is wrong, or an observable component
        has no finite value or variance.
    """

    hours: float
    faults: NDArray[np.float64]
    covariance: NDArray[np.float64]
    unobservable: NDArray[np.bool_]
    stamp_ns: int = 0

    def __post_init__(self) -> None:
        if not 0.0 <= self.hours < math.inf:
            raise ValueError(f"hours = {self.hours!r} h: expected a number of at least 0")
        for name, kind, shape in (
            ("faults", np.float64, (N_FAULTS,)),
            ("covariance", np.float64, (N_FAULTS, N_FAULTS)),
            ("unobservable", np.bool_, (N_FAULTS,)),
        ):
            values = np.array(getattr(self, name), dtype=kind)
            if values.shape != shape:
                raise ValueError(f"{name} of an observation has shape {values.shape}, not {shape}")
            object.__setattr__(self, name, values)
        seen = ~self.unobservable
        if not np.all(np.isfinite(self.faults[seen])):
            raise ValueError(f"faults = {self.faults}: an observable component is not finite")
        variances = np.diag(self.covariance)[seen]
        if not np.all((variances >= 0.0) & (variances < math.inf)):
            raise ValueError(f"variances = {variances}: expected numbers of at least 0")

    @classmethod
    def of(cls, estimate: Estimate, hours: float) -> Self:
        """Return the observation that an estimate makes.

        Parameters
        ----------
        estimate
            What was found in a window.
        hours
            Service hour of the window [h].

        Raises
        ------
        ValueError
            When the estimate is not valid, or the hours are no number of at least 0.
        """
        if not estimate.valid:
            raise ValueError(f"an estimate that is not valid tells nothing: {estimate.reason}")
        return cls(
            float(hours),
            estimate.faults,
            estimate.covariance,
            estimate.unobservable,
            estimate.end_ns,
        )

    @property
    def at_healthy(self) -> NDArray[np.bool_]:
        """Observable components that were put back to healthy: they lie somewhere near it."""
        return ~self.unobservable & (self.faults == healthy_faults())

    @property
    def variance(self) -> NDArray[np.float64]:
        """Variances, ``(8,)``; infinite where unobservable."""
        return np.where(self.unobservable, np.inf, np.diag(self.covariance))
