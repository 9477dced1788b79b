# SPDX-License-Identifier: Apache-2.0
"""Classification of a standstill under a moving command: failure, drive off, or short command."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from ema_core.linear import DisplayUnit
from ema_core.telemetry import Telemetry
from ema_monitor.joint.baseline import Baseline
from ema_monitor.reasons import JointStill, StandstillCause

_LARGE_EFFORT: Final = 0.9
"""Quantile of the absolute effort that counts as the effort of a standstill [-]."""
_ACTING: Final = 0.5
"""Smallest effort that should move a healthy joint, relative to its dry friction [-]."""
_FAR: Final = 0.5
"""Smallest command travel that should move the joint, relative to the shortest healthy record [-].
"""


@dataclass(frozen=True)
class Standstill:
    """Standstill of a joint although its command moves."""

    cause: StandstillCause
    """Cause of the standstill."""
    travel: float
    """Travel of the command, from end to end [rad]."""
    least_travel: float
    """Minimum command travel at which a standstill counts as a failure [rad]."""
    effort: float
    """Effort during the standstill, in the unit of the baseline."""
    friction: float
    """Healthy dry friction, in the unit of the baseline."""

    def reason(self, effort: DisplayUnit, angle: DisplayUnit) -> JointStill:
        """Return the reason for the refusal of a record, in display units."""
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
    """Return the standstill of a record, with its cause from effort and command travel."""
    travel = float(np.ptp(telemetry.command))
    least_travel = _FAR * min(record.travel for record in baseline.records)
    effort = float(np.quantile(np.abs(telemetry.current), _LARGE_EFFORT))
    cause = StandstillCause.FAILURE
    if effort < _ACTING * baseline.friction:
        cause = StandstillCause.NO_EFFORT
    elif travel < least_travel:
        cause = StandstillCause.SHORT_COMMAND
    return Standstill(cause, travel, least_travel, effort, baseline.friction)
