"""Scale and sign of the effort of a record, by the coefficients of the healthy records."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.comparison import FRICTION, INERTIA
from ema_monitor.joint.record import JointRecord
from ema_monitor.joint.shape import DRY
from ema_monitor.joint.shape import INERTIA as INERTIA_AT

_OTHER_UNIT: Final = 5.0
"""Ratio of friction and inertia from which on the effort has another unit [-]."""
_OTHER_FRICTION: Final = 20.0
"""The same ratio of the friction, where the inertia is unknown [-]."""
_BEYOND_DOUBT: Final = 4.0
"""Standard deviations below 0 from which on a coefficient is negative."""


@dataclass(frozen=True)
class EffortScale:
    """Ratio of the coefficients of a record to those of the healthy records.

    Attributes
    ----------
    factor
        Ratio of the friction, which is better determined than the inertia [-].
    is_scaled
        Whether all coefficients are scaled as by another unit.
    negative
        Name of the quantity that is below 0 beyond doubt, and its ratio [-]; None without one.
    """

    factor: float
    is_scaled: bool
    negative: tuple[str, float] | None


def effort_scale(record: JointRecord, baseline: Baseline) -> EffortScale:
    """Return the scale of the effort of a record.

    Friction alone may grow several times. With inertia it does so by another unit, sign or sensor.
    Friction and inertia below 0 are of another sign, or of an effort that is late.
    """
    has_inertia = baseline.shape.has_inertia
    shown = [DRY, INERTIA_AT] if has_inertia else [DRY]
    healthy = baseline.healthy[shown]
    ratios = record.values[shown] / healthy
    errors = np.hypot(np.sqrt(np.diag(record.covariance)), baseline.motion_errors(record))[shown]
    is_negative = ratios < -_BEYOND_DOUBT * np.abs(errors / healthy)
    highest = _OTHER_UNIT if has_inertia else _OTHER_FRICTION
    is_scaled = np.all(ratios > highest) or np.all(ratios < 1.0 / _OTHER_UNIT)
    negative = None
    if np.any(is_negative):
        at = int(np.argmax(is_negative))
        negative = (FRICTION, INERTIA)[at], float(ratios[at])
    return EffortScale(float(ratios[0]), bool(is_scaled), negative)
