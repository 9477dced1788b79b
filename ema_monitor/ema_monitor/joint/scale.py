# SPDX-License-Identifier: Apache-2.0
"""Scale and sign of the effort of a record, relative to the healthy records."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.record import JointRecord
from ema_monitor.joint.shape import DRY
from ema_monitor.joint.shape import INERTIA as INERTIA_AT
from ema_monitor.quantities import FRICTION, INERTIA

_CERTAIN: Final = 4.0
"""Number of standard deviations below 0 at which a coefficient counts as negative."""


@dataclass(frozen=True)
class EffortScale:
    """Scale and sign of the effort in a record, relative to the healthy records."""

    friction: float
    """Ratio of the friction to its healthy value [-]."""
    inertia: float | None
    """Ratio of the inertia to its healthy value [-]; None if unknown."""
    negative: tuple[str, float] | None
    """Name and ratio [-] of a quantity that is significantly negative, or None."""


def effort_scale(record: JointRecord, baseline: Baseline) -> EffortScale:
    """Return the scale and sign of the effort in a record.

    Negative friction or inertia results from a wrong sign or a delay of the effort.
    `ema_core.columns.of_records` decides whether the effort has a different unit.
    """
    has_inertia = baseline.shape.has_inertia
    compared = [DRY, INERTIA_AT] if has_inertia else [DRY]
    healthy = baseline.healthy[compared]
    ratios = record.values[compared] / healthy
    sigmas = np.hypot(np.sqrt(np.diag(record.covariance)), baseline.motion_errors(record))
    errors = sigmas[compared]
    is_negative = ratios < -_CERTAIN * np.abs(errors / healthy)
    negative = None
    if np.any(is_negative):
        at = int(np.argmax(is_negative))
        negative = (FRICTION, INERTIA)[at], float(ratios[at])
    return EffortScale(float(ratios[0]), float(ratios[1]) if has_inertia else None, negative)
