# SPDX-License-Identifier: Apache-2.0
"""Fault measurement from a valid test."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Self

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.expecting import require_type
from ema_core.faults import INDICES, N_FAULTS, healthy_faults
from ema_core.quantity import is_finite_number
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.uncertainty import SIGNIFICANT_SIGMAS

HEALTHY: Final = healthy_faults()[INDICES]
REACH: Final = SIGNIFICANT_SIGMAS[INDICES]
"""Distance within which an estimate is set to healthy, ``(7,)`` [standard deviations]."""

_AS_SERVICE: Final = np.empty(0)


@dataclass(frozen=True, eq=False)
class Measurement:
    """Fault vector measured by a valid test, with its uncertainty and time.

    Raises
    ------
    ValueError
        If the hours are negative or NaN, a shape is wrong, or an observable component has no finite
        value or variance.
    """

    hours: float
    """Service hour of the test [h]."""
    faults: Array
    """Fault vector, ``(8,)``."""
    covariance: Array
    """Covariance of the fault vector, ``(8, 8)``; unobservable rows and columns are ignored."""
    unobservable: Flags
    """Components that the test does not show, ``(8,)``."""
    own_hours: Array = field(default_factory=lambda: _AS_SERVICE)
    """Growth hours of each tracked component, ``(7,)`` [h]; the service hour by default.

    Growth hours are hours at the reference duty that cause the same damage (P23).
    """

    def __post_init__(self) -> None:
        if not (is_finite_number(self.hours) and self.hours >= 0.0):
            raise ValueError(f"hours = {self.hours!r} h: expected a number of at least 0")
        object.__setattr__(self, "hours", float(self.hours))
        for name, kind, shape in (
            ("faults", np.float64, (N_FAULTS,)),
            ("covariance", np.float64, (N_FAULTS, N_FAULTS)),
            ("unobservable", np.bool_, (N_FAULTS,)),
        ):
            values = np.array(getattr(self, name), dtype=kind)
            if values.shape != shape:
                raise ValueError(
                    f"{name} of a measurement has shape {values.shape}, expected {shape}"
                )
            object.__setattr__(self, name, values)
        if not self.own_hours.size:
            object.__setattr__(self, "own_hours", np.full(len(INDICES), self.hours))
        seen = ~self.unobservable
        if not np.all(np.isfinite(self.faults[seen])):
            raise ValueError(f"faults = {self.faults}: an observable component is not finite")
        variances = np.diag(self.covariance)[seen]
        if not np.all((variances >= 0.0) & (variances < math.inf)):
            raise ValueError(f"variances = {variances}: expected numbers of at least 0")

    @classmethod
    def of(cls, estimate: Estimate, hours: float, own_hours: Array = _AS_SERVICE) -> Self:
        """Return the measurement of a valid estimate.

        Raises
        ------
        ValueError
            If the estimate is invalid, an argument has a wrong type, or the hours are negative or
            NaN.
        """
        require_type("estimate", estimate, Estimate, "identify(window) returns one")
        if not estimate.valid:
            raise ValueError(f"cannot use an estimate that is not valid: {estimate.reason}")
        faults, covariance = np.array(estimate.faults), estimate.covariance
        return cls(hours, faults, covariance, estimate.unobservable, own_hours)

    def as_row(self) -> Array:
        """Return the measurement as an array, for ``of_row``."""
        figures = (self.faults, self.unobservable, self.own_hours, self.covariance.ravel())
        return np.concatenate([[self.hours], *figures])

    @classmethod
    def of_row(cls, row: Array) -> Self:
        """Return the measurement from the result of ``as_row``."""
        ends = np.cumsum([1, N_FAULTS, N_FAULTS, len(INDICES)])
        (hours,), faults, unobservable, growth_hours, covariance = np.split(row, ends)
        square, hidden = covariance.reshape(N_FAULTS, N_FAULTS), unobservable.astype(np.bool_)
        return cls(float(hours), faults, square, hidden, growth_hours)

    @cached_property
    def seen(self) -> Flags:
        """Whether the test shows each tracked component, ``(7,)``."""
        return ~self.unobservable[INDICES]

    @cached_property
    def near_healthy(self) -> Flags:
        """Whether the estimate set each tracked component to healthy, ``(7,)``."""
        return self.seen & (self.faults[INDICES] == HEALTHY)

    @cached_property
    def value(self) -> Array:
        """Signed distance of each tracked component from healthy, ``(7,)`` [-]."""
        return np.where(self.seen, self.faults[INDICES] - HEALTHY, 0.0)

    @cached_property
    def noise(self) -> Array:
        """Error variance of ``value``, ``(7,)`` [-]; 1 for components not shown."""
        return np.where(self.seen, np.diag(self.covariance)[INDICES], 1.0)

    def normalized_innovation(self, mean: Array, variance: Array) -> Array:
        """Return each component's absolute normalized innovation, ``(7,)`` [sigmas].

        If the estimate set a component to healthy, only the part beyond ``REACH`` counts. The
        innovation is 0 for components that are not shown.
        """
        away = np.abs(self.value - mean)
        reach = np.where(self.near_healthy, REACH * np.sqrt(self.noise), 0.0)
        total = np.sqrt(self.noise + variance)
        return np.where(self.seen, np.maximum(away - reach, 0.0) / total, 0.0)
