# SPDX-License-Identifier: Apache-2.0
"""Progress of a baseline: its records, its detection limits, and advice on improving it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ema_core.wording import counted
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.joint.trend import friction_rise
from ema_monitor.joint.wording import advice_sentences
from ema_monitor.quantities import FRICTION
from ema_monitor.reasons import Learning
from ema_monitor.windows.window import Window

FEWEST: Final = 3
"""Minimum number of records in a baseline: fewer records show no scatter."""

_MOVING: Final = 0.05
_BLIND: Final = 1.0
"""Relative change of friction that a baseline must be able to detect [-]."""


@dataclass(frozen=True)
class BaselineProgress:
    """Progress in collecting the records of a baseline."""

    records: int = 0
    """Number of records in the accepted baseline, or collected so far while learning."""
    days: int = 0
    """Number of days of the records; records without a date count as one day."""
    records_needed: int = 0
    """Number of records for automatic acceptance; 0 if a person accepts."""
    slowest: float = math.nan
    """Slowest usual speed of the records [rad/s; m/s for a drive with a lead]."""
    fastest: float = math.nan
    """Fastest usual speed of the records [rad/s; m/s for a drive with a lead]."""
    forward_share: float = math.nan
    """Share of the moving time in which the joint moves forward [-]."""
    detectable_same_day: float = math.nan
    """Smallest detectable relative change of friction on a day with records [-]."""
    detectable_other_day: float = math.nan
    """Smallest detectable relative change of friction on any other day [-]."""
    advice: tuple[str, ...] = ()
    """Sentences on how to lower the smallest detectable change."""
    reason: str = ""
    """Why the records cannot become a baseline; empty if they can."""

    @property
    def as_reason(self) -> Learning:
        """The progress, as the reason why a record is not judged yet."""
        return Learning(
            self.records,
            self.days,
            self.records_needed,
            self.detectable_same_day,
            self.detectable_other_day,
            self.reason,
        )


def progress_of(
    calibration: JointCalibration | None,
    records: int,
    days: int,
    forward_share: float,
    reason: str,
    records_needed: int = 0,
) -> BaselineProgress:
    """Return the progress of a baseline.

    Parameters
    ----------
    calibration
        Calibration fitted to the records; None if there is none.
    records, days
        Number of records and of their days.
    forward_share
        Share of the moving time in which the joint moves forward [-].
    reason
        Why the records cannot become a baseline; empty if they can.
    records_needed
        Number of records for automatic acceptance; 0 if a person accepts.
    """
    if calibration is None:
        return BaselineProgress(records, days, records_needed, reason=reason)
    comparer = calibration.comparer
    lead = calibration.parameters.lead
    travel_per_radian = lead / (2.0 * math.pi) if lead else 1.0
    speeds = [travel_per_radian * record.usual_speed for record in calibration.baseline.records]
    return BaselineProgress(
        records,
        days,
        records_needed,
        min(speeds),
        max(speeds),
        forward_share,
        comparer.smallest_changes_of_a_day[FRICTION],
        comparer.smallest_changes[FRICTION],
        tuple(advice_sentences(comparer)),
        reason,
    )


def refusal_of(calibration: JointCalibration, *, accepts_outliers: bool = False) -> str:
    """Return why a calibration cannot be accepted as a baseline; empty if it can.

    Parameters
    ----------
    calibration
        Calibration fitted to the records.
    accepts_outliers
        Whether a person confirms that all records are healthy, although some are outliers or
        friction rises.
    """
    if calibration.windows < FEWEST:
        return (
            f"{counted(calibration.windows, 'usable record')}: a baseline needs at least {FEWEST}"
        )
    smallest = calibration.comparer.smallest_changes_of_a_day[FRICTION]
    if not smallest < _BLIND:
        return (
            "the records do not judge friction: even a doubling would not show; record more motion "
            "in both directions"
        )
    if accepts_outliers:
        return ""
    if calibration.outliers:
        return "; ".join(map(str, calibration.outliers))
    if rise := friction_rise(calibration.baseline):
        return (
            f"friction rises by {100.0 * rise:.0f} % over the records, as in a joint that wears: "
            "reset the baseline after a repair, or confirm that the joint was healthy"
        )
    return ""


def forward_share(windows: Sequence[Window]) -> float:
    """Return the share of the moving time in which the position increases [-]; NaN at rest."""
    forward_s = moving_s = 0.0
    for window in windows:
        speed = np.diff(window.telemetry.position)
        least = _MOVING * float(np.percentile(np.abs(speed), 95.0))
        forward_s += window.sample_period * float(np.count_nonzero(speed > least))
        moving_s += window.sample_period * float(np.count_nonzero(np.abs(speed) > least))
    return forward_s / moving_s if moving_s else math.nan
