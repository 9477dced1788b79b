"""Standstill of a joint although its command moves: a failure, or a drive that is off."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from ema_core.linear import DisplayUnit
from ema_core.telemetry import Telemetry
from ema_monitor.joint.baseline import Baseline
from ema_monitor.reasons import JointStill

_LARGE_EFFORT: Final = 0.9
"""Quantile of the absolute effort used to judge a joint at rest [-]."""
_ACTING: Final = 0.5
"""Least effort that moves a healthy joint, over its dry friction [-]."""
_FAR: Final = 0.5
"""Least travel of the command over the travel of the healthy records [-]."""


class StandstillCause(StrEnum):
    """Why a joint does not follow its command."""

    NO_EFFORT = "no_effort"
    """The effort is far below the friction: the drive is off, or a brake on."""
    SHORT_COMMAND = "short_command"
    """The command travels less than in healthy records: the joint may not have to move."""
    FAILURE = "failure"
    """Effort and command would move a healthy joint."""


@dataclass(frozen=True)
class Standstill:
    """Standstill of a joint although its command moves."""

    cause: StandstillCause
    """Why the joint does not follow its command."""
    travel: float
    """Travel of the command [rad]."""
    least_travel: float
    """Minimum command travel at which a standstill counts as a failure [rad]."""
    effort: float
    """Acting effort, in the unit of the baseline."""
    friction: float
    """Healthy dry friction, in the unit of the baseline."""

    def reason(self, effort: DisplayUnit, angle: DisplayUnit) -> JointStill:
        """Return the standstill as a reason, in the display units of effort and position."""
        return JointStill(
            self.cause,
            angle.scale * self.travel,
            angle.scale * self.least_travel,
            angle.unit,
            effort.scale * self.effort,
            effort.scale * self.friction,
            effort.unit,
        )


def standstill_of(telemetry: Telemetry, baseline: Baseline) -> Standstill:
    """Return the standstill of a record, classified by its effort and the travel of its command."""
    travel = float(np.ptp(telemetry.command))
    least_travel = _FAR * min(record.travel for record in baseline.records)
    effort = float(np.quantile(np.abs(telemetry.current), _LARGE_EFFORT))
    cause = StandstillCause.FAILURE
    if effort < _ACTING * baseline.friction:
        cause = StandstillCause.NO_EFFORT
    elif travel < least_travel:
        cause = StandstillCause.SHORT_COMMAND
    return Standstill(cause, travel, least_travel, effort, baseline.friction)
