"""Baseline of a joint: its healthy records, and what they predict for a further one."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint.record import JointRecord
from ema_monitor.joint.shape import COEFFICIENTS, DRY, GRAVITY, INERTIA, LOAD, VISCOUS, Shape
from ema_monitor.joint.signals import Preparation

BETWEEN_DAYS: Final = {
    "friction": 0.007,
    "inertia": 0.007,
    "viscous_friction": 0.04,
    "viscous_of_friction": 0.004,
    "load": 0.004,
    "gravity": 0.04,
}
"""Prior medians of the standard deviation between days: relative, of viscous friction also and of
the load only as a share of the dry friction at the usual speed [-]."""

BETWEEN_RECORDS: Final = 0.6
"""Prior medians between records of a day, over those between days [-]."""

_FLOOR: Final = 1e-9


@dataclass(frozen=True)
class Baseline:
    """Healthy records of a unit, with the model that they were fitted with.

    Attributes
    ----------
    preparation, shape
        How records are prepared, and the terms of the model.
    records
        Healthy records.
    """

    preparation: Preparation
    shape: Shape
    records: tuple[JointRecord, ...] = field(repr=False)

    @cached_property
    def days(self) -> tuple[int, ...]:
        """Day of each record."""
        return tuple(one.day for one in self.records)

    @cached_property
    def values(self) -> Array:
        """Coefficients of the records, ``(n, 5)``."""
        return np.array([one.values for one in self.records])

    @cached_property
    def covariances(self) -> Array:
        """Covariances of their errors, ``(n, 5, 5)``."""
        return np.array([one.covariance for one in self.records])

    @cached_property
    def healthy(self) -> Array:
        """Healthy coefficients, ``(5,)``."""
        weights = 1.0 / (
            np.diagonal(self.covariances, axis1=1, axis2=2) + self.prior_sigmas**2 + _FLOOR**2
        )
        return np.sum(weights * self.values, axis=0) / np.sum(weights, axis=0)

    @cached_property
    def friction(self) -> float:
        """Healthy dry friction [A]."""
        return abs(self.shape.friction_scale * float(np.median(self.values[:, DRY])))

    @property
    def viscous_scale(self) -> float:
        """All friction at the usual speed over that speed [A.s/rad]."""
        usual = self.preparation.usual_speed
        return self.friction / usual + max(float(np.median(self.values[:, VISCOUS])), 0.0)

    @cached_property
    def prior_sigmas(self) -> Array:
        """Prior medians of the standard deviations between days, ``(5,)``, in their units."""
        median = np.median(self.values, axis=0)
        friction = abs(self.shape.friction_scale * median[DRY])
        of_speed = friction / self.preparation.usual_speed
        sigmas = np.empty(len(COEFFICIENTS))
        sigmas[DRY] = BETWEEN_DAYS["friction"] * abs(median[DRY])
        sigmas[INERTIA] = BETWEEN_DAYS["inertia"] * abs(median[INERTIA])
        sigmas[VISCOUS] = np.hypot(
            BETWEEN_DAYS["viscous_friction"] * median[VISCOUS],
            BETWEEN_DAYS["viscous_of_friction"] * of_speed,
        )
        sigmas[LOAD] = BETWEEN_DAYS["load"] * friction
        sigmas[GRAVITY] = BETWEEN_DAYS["gravity"]
        return np.maximum(sigmas, _FLOOR)
