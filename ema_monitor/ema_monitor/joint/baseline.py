# SPDX-License-Identifier: Apache-2.0
"""Baseline of a joint: the healthy records and the effort model fitted to them."""

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.dates import FIRST_DATE_NS
from ema_core.wording import unknown_name
from ema_monitor.joint.departure import HEALTHY
from ema_monitor.joint.figures import SPEED_STEPS
from ema_monitor.joint.record import NS_A_DAY, JointRecord, LabelledRecord
from ema_monitor.joint.shape import COEFFICIENTS, DRY, GRAVITY, INERTIA, LOAD, VISCOUS, Shape
from ema_monitor.joint.signals import Preparation
from ema_monitor.joint.single import BETWEEN_RECORDS
from ema_monitor.quantities import TORQUE
from ema_monitor.quantities import VISCOUS as VISCOUS_FRICTION

BETWEEN_DAYS: Final = {
    "friction": 0.008,
    "inertia": 0.007,
    "viscous_friction": 0.08,
    "viscous_of_friction": 0.004,
    "load": 0.004,
    "gravity": 0.04,
}
"""Prior medians of the standard deviation between days, relative to the coefficient [-].

The load is relative to the dry friction. Viscous friction has a second part,
``viscous_of_friction``, relative to the dry friction divided by the usual speed. The viscosity of
lubricants falls by 3 to 6 % per kelvin, and the temperature differs by a few kelvin between days.
"""

SHARE_OF_SHOWN: Final = 0.3
"""Smallest prior median of a scatter, relative to the scatter of the healthy records [-]."""

_SAME_MOTION: Final = 0.012
_SAME_STEPS: Final = 0.09
_FEWEST_REPEATED: Final = 3
_MOTION_TOLERANCE: Final = 0.1
_LATE: Final = 0.05
_UNEXPLAINED: Final = 0.3
_UNCERTAIN: Final = 0.15
_ENOUGH_RECORDS: Final = 5
_FLOOR: Final = 1e-9
_PAYLOAD: Final = [INERTIA, LOAD, GRAVITY]


class Shortcoming(Enum):
    """Deficiency of the healthy records of a baseline."""

    NO_DATES = auto()
    """The timestamps of a record have no date."""
    ONE_DAY = auto()
    """All records are from one day."""
    FEW_RECORDS = auto()
    """There are fewer than five records."""
    ONE_SPEED = auto()
    """The speed hardly varies: viscous and Coulomb friction are not distinguishable. It is not
    reported if the model leaves too much of the effort unexplained."""
    UNEXPLAINED_EFFORT = auto()
    """The model does not explain a large part of the effort, and the records do not determine both
    inertia and viscous friction."""
    UNCERTAIN_FRICTION = auto()
    """Effort outside the model makes the friction uncertain by more than 15 %."""


@dataclass(frozen=True)
class Baseline:
    """Healthy records of a unit and the effort model fitted to them."""

    preparation: Preparation
    """Filter and corrections of the records."""
    shape: Shape
    """Terms of the model."""
    records: tuple[JointRecord, ...] = field(repr=False)
    """Healthy records."""
    labelled: tuple[LabelledRecord, ...] = field(default=(), repr=False)
    """Records of labelled states."""

    @cached_property
    def days(self) -> tuple[int, ...]:
        """Day of each record, counted from 1970-01-01; 0 without a date."""
        return tuple(record.day for record in self.records)

    @cached_property
    def values(self) -> Array:
        """Coefficients of all records, ``(n, 5)``."""
        return np.array([record.values for record in self.records])

    @cached_property
    def covariances(self) -> Array:
        """Error covariances of all records, ``(n, 5, 5)``."""
        return np.array([record.covariance for record in self.records])

    @cached_property
    def healthy(self) -> Array:
        """Healthy coefficients: the mean over the records weighted by precision, ``(5,)``."""
        weights = 1.0 / (np.diagonal(self.covariances, axis1=1, axis2=2) + self.prior_sigmas**2)
        return np.sum(weights * self.values, axis=0) / np.sum(weights, axis=0)

    @cached_property
    def friction(self) -> float:
        """Healthy dry friction [A]."""
        return abs(self.shape.friction_scale * float(np.median(self.values[:, DRY])))

    @cached_property
    def repeats(self) -> bool:
        """Whether the healthy records repeat one motion; False for fewer than three records."""
        if len(self.records) < _FEWEST_REPEATED:
            return False
        steps = [
            record.figures[SPEED_STEPS] for record in self.records if SPEED_STEPS in record.figures
        ]
        accelerates_alike = len(steps) < _FEWEST_REPEATED or np.std(steps, ddof=1) <= _SAME_STEPS
        is_alike = np.all(np.std(self._motions, axis=0, ddof=1) <= _SAME_MOTION)
        return bool(is_alike and accelerates_alike)

    def distance(self, record: JointRecord) -> float:
        """Return how far the speed and travel of a record are outside the healthy range [-].

        The distance is the logarithm of the ratio to the nearest healthy value. The larger of
        the distances of speed and travel is returned; it is 0 within the healthy range.
        """
        return _outside(self._motions, np.log([record.usual_speed, record.travel]))

    @property
    def _motions(self) -> Array:
        """Logarithms of speed and travel of the records, ``(n, 2)``."""
        return np.log([(record.usual_speed, record.travel) for record in self.records])

    def motion_errors(self, record: JointRecord) -> Array:
        """Return the standard errors of the coefficients due to an unusual motion, ``(5,)``.

        They are in the units of the coefficients, and 0 if speed and travel are within the healthy
        range. A small timing error of the inertial effort looks like friction. This apparent
        friction changes with the ratio of speed to travel.
        """
        errors = _MOTION_TOLERANCE * self.distance(record) * self.scales
        paces = self._motions @ [1.0, -1.0]
        pace = _outside(paces[:, None], np.log([record.usual_speed / record.travel]))
        if pace > 0.0 and self.shape.has_inertia:
            mean = math.exp(float(np.mean(paces)))
            inertial = abs(self.healthy[INERTIA]) * self.preparation.usual_speed * mean
            late = _LATE * pace * inertial / self.friction
            mixed = [DRY, VISCOUS]
            errors[mixed] = np.hypot(errors[mixed], late * self.scales[mixed])
        return errors

    @property
    def is_unexplained(self) -> bool:
        """Whether the model leaves too much of the effort unexplained to detect small changes."""
        return self.shape.unexplained > _UNEXPLAINED

    @property
    def is_friction_uncertain(self) -> bool:
        """Whether effort outside the model makes the friction uncertain by more than 15 %."""
        return self.shape.friction_error > _UNCERTAIN

    @property
    def shortcomings(self) -> tuple[Shortcoming, ...]:
        """Deficiencies of the healthy records."""
        is_missing = {
            Shortcoming.NO_DATES: 0 in self.days,
            Shortcoming.ONE_DAY: len(set(self.days)) < 2 and 0 not in self.days,
            Shortcoming.FEW_RECORDS: len(self.records) < _ENOUGH_RECORDS,
            Shortcoming.ONE_SPEED: not self.shape.has_viscous and not self.is_unexplained,
            Shortcoming.UNEXPLAINED_EFFORT: self.is_unexplained
            and not (self.shape.has_viscous and self.shape.has_inertia),
            Shortcoming.UNCERTAIN_FRICTION: self.is_friction_uncertain,
        }
        return tuple(gap for gap, missing in is_missing.items() if missing)

    def with_labels(self, labelled: Iterable[LabelledRecord]) -> "Baseline":
        """Return the baseline with its labelled records replaced by ``labelled``."""
        return replace(self, labelled=tuple(labelled))

    def with_record(self, state: str, record: JointRecord) -> "Baseline":
        """Return the baseline with a record labelled as ``state``, replacing its earlier label.

        Raises
        ------
        ValueError
            If the record belongs to the healthy records.
        """
        if any(healthy.is_same(record) for healthy in self.records):
            raise ValueError("it is one of the healthy records of the calibration")
        kept = (label for label in self.labelled if not label.record.is_same(record))
        return self.with_labels((*kept, LabelledRecord(state, record)))

    def without(self, state: str) -> "Baseline":
        """Return the baseline without the records labelled ``state``.

        Raises
        ------
        ValueError
            If no record has this label.
        """
        kept = [label for label in self.labelled if label.state != state]
        if len(kept) == len(self.labelled):
            raise ValueError(unknown_name("state", state, self.states().keys() - {HEALTHY}))
        return self.with_labels(kept)

    def states(self) -> dict[str, int]:
        """Return the number of records of each state, including ``HEALTHY``."""
        return Counter([HEALTHY] * len(self.records) + [label.state for label in self.labelled])

    def extended(self, records: int, days: int) -> "Baseline":
        """Return the baseline extended by hypothetical records with the same scatter.

        If the existing records do not determine a scatter, its prior median is used.

        Parameters
        ----------
        records
            Number of further records.
        days
            Number of further days over which the records are spread; 0 adds them to the last day.
        """
        numbers = np.array(self.days)
        means = np.array([self.values[numbers == day].mean(axis=0) for day in sorted(set(numbers))])
        day_sigmas = self.prior_sigmas
        if len(means) > 1:
            day_sigmas = np.std(means, axis=0, ddof=1)
        within = self.values - means[np.searchsorted(sorted(set(numbers)), numbers)]
        record_sigmas = BETWEEN_RECORDS * self.prior_sigmas
        if len(self.records) > len(means):
            record_sigmas = np.sqrt(np.sum(within**2, axis=0) / (len(self.records) - len(means)))
        added = []
        for number in range(records):
            template = self.records[number % len(self.records)]
            later_days = 1 + number % days if days else 0
            day_effect = day_sigmas * (-1.0) ** later_days if days else means[-1] - self.healthy
            sign = (-1.0) ** (number // max(days, 1))
            values = self.healthy + day_effect + record_sigmas * sign
            stamp_ns = self.records[-1].stamp_ns
            if later_days:
                stamp_ns = max(stamp_ns, FIRST_DATE_NS) + later_days * NS_A_DAY
            added.append(replace(template, stamp_ns=stamp_ns, values=values))
        return replace(self, records=(*self.records, *added))

    @property
    def viscous_scale(self) -> float:
        """Ratio of the total friction at the usual speed to the usual speed [A.s/rad]."""
        usual = self.preparation.usual_speed
        return self.friction / usual + max(float(np.median(self.values[:, VISCOUS])), 0.0)

    @property
    def hidden_in_friction(self) -> tuple[str, ...]:
        """Quantities that cannot be distinguished from Coulomb friction in the healthy motion."""
        viscous = [] if self.shape.has_viscous else [VISCOUS_FRICTION]
        # Friction and load alone do not determine the torque per ampere.
        return (*viscous, *([] if self.shows_torque else [TORQUE]))

    @property
    def shows_torque(self) -> bool:
        """Whether terms other than friction and load determine the torque per ampere."""
        return int(np.sum(self.shape.used)) > 2

    @property
    def scales(self) -> Array:
        """Reference value for changes of each coefficient, ``(5,)``, in its unit."""
        scales = np.abs(self.healthy)
        scales[VISCOUS], scales[LOAD] = self.viscous_scale, self.friction
        return scales

    @cached_property
    def prior_sigmas(self) -> Array:
        """Prior median of each coefficient's standard deviation between days, ``(5,)``."""
        median = np.median(self.values, axis=0)
        friction = abs(self.shape.friction_scale * median[DRY])
        friction_over_speed = friction / self.preparation.usual_speed
        sigmas = np.empty(len(COEFFICIENTS))
        sigmas[DRY] = BETWEEN_DAYS["friction"] * abs(median[DRY])
        sigmas[INERTIA] = BETWEEN_DAYS["inertia"] * abs(median[INERTIA])
        sigmas[VISCOUS] = np.hypot(
            BETWEEN_DAYS["viscous_friction"] * median[VISCOUS],
            BETWEEN_DAYS["viscous_of_friction"] * friction_over_speed,
        )
        sigmas[LOAD] = BETWEEN_DAYS["load"] * friction
        sigmas[GRAVITY] = BETWEEN_DAYS["gravity"]
        # Payloads vary with the task. They also change the load, which includes gravity at the
        # centre. The grid of scatters ends at a few times the prior median.
        shown = SHARE_OF_SHOWN * np.std(self.values[:, _PAYLOAD], axis=0)
        sigmas[_PAYLOAD] = np.maximum(sigmas[_PAYLOAD], shown)
        return np.maximum(sigmas, _FLOOR * np.array([1.0, *[friction] * 3, 1.0]))


def _outside(healthy: Array, values: Array) -> float:
    """Return the largest distance of values, ``(k,)``, from the range of ``healthy``, ``(n, k)``.

    The distance is 0 within the range.
    """
    excess = np.maximum(healthy.min(axis=0) - values, values - healthy.max(axis=0))
    return float(np.max(excess, initial=0.0))
