"""Standstill of a joint whose command moves: a failure, or a joint that is not driven."""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

import numpy as np

from ema_core.telemetry import Telemetry
from ema_monitor.joint.baseline import Baseline

_LARGE_EFFORT: Final = 0.9
"""Quantile of the size of the effort that a joint at rest is judged by [-]."""
_ACTING: Final = 0.5
"""Effort that moves a healthy joint, over its dry friction, at least [-]."""
_FAR: Final = 0.5
"""Least travel of the command over the travel of the healthy records [-]."""


class StandstillCause(Enum):
    """Why a joint does not follow its command."""

    NO_EFFORT = auto()
    """The effort is far below the friction: the drive is off, or a brake on."""
    SHORT_COMMAND = auto()
    """The command travels less than in healthy records: the joint may not have to move."""
    FAILURE = auto()
    """Effort and command would move a healthy joint."""


@dataclass(frozen=True)
class Standstill:
    """A joint that stands still although its command moves.

    Attributes
    ----------
    cause
        Why it does not follow.
    travel, least_travel
        Travel of the command, and the least travel by which a failure is told [rad].
    effort, friction
        Effort that acts, and healthy friction, in the unit of the baseline.
    """

    cause: StandstillCause
    travel: float
    least_travel: float
    effort: float
    friction: float


def standstill_of(telemetry: Telemetry, baseline: Baseline) -> Standstill:
    """Return why the joint of a record stands still, by effort and command of healthy records."""
    travel = float(np.ptp(telemetry.command))
    least_travel = _FAR * min(record.travel for record in baseline.records)
    effort = float(np.quantile(np.abs(telemetry.current), _LARGE_EFFORT))
    cause = StandstillCause.FAILURE
    if effort < _ACTING * baseline.friction:
        cause = StandstillCause.NO_EFFORT
    elif travel < least_travel:
        cause = StandstillCause.SHORT_COMMAND
    return Standstill(cause, travel, least_travel, effort, baseline.friction)
