# SPDX-License-Identifier: Apache-2.0
"""The error of a current, compared with what acceleration and friction require."""

from ema_core.columns.errors import ColumnError, Reference
from ema_core.columns.mistakes import SIGN, Kind, usual_mistakes
from ema_core.columns.tolerances import (
    CORRELATED,
    CURRENT_SIZE,
    GAINS_ENERGY,
    NEAR_THOUSANDTHS,
    is_beyond,
)


def wrong_current(size: float, correlation: float, tau: float) -> ColumnError | None:
    """Return the error of a current with a wrong sign or scale, or None.

    Inertia and friction of the drive must be known.

    Parameters
    ----------
    size
        RMS of the current over the RMS of the required current [-].
    correlation
        Correlation of the current with the required current [-].
    tau
        Gear ratio, user over motor speed [-].
    """
    if correlation < -CORRELATED:
        return ColumnError(("current",), -size, Reference.INERTIA, (SIGN,))
    if correlation < CORRELATED:
        return None
    for mistake in usual_mistakes("current", tau):
        if mistake.kind is Kind.SCALE and not is_beyond(size / mistake.factor, NEAR_THOUSANDTHS):
            return ColumnError(("current",), size, Reference.INERTIA, (mistake,))
    if is_beyond(size, CURRENT_SIZE):
        return ColumnError(("current",), size, Reference.INERTIA)
    return None


def reversed_current(dissipation: float | None, work_share: float) -> ColumnError | None:
    """Return the error of the current of an unknown drive if its sign is wrong, or None.

    After a step of the command, an effort with the right sign may oppose the speed, because the
    drive brakes. The sign is wrong only if the effort also takes energy from the motion in total.

    Parameters
    ----------
    dissipation
        Correlation of current and speed without inertia, gravity and load [-]; None if unknown.
    work_share
        Net work of the effort over its absolute work [-].
    """
    is_opposed = dissipation is not None and dissipation < -CORRELATED
    if is_opposed and work_share < -GAINS_ENERGY:
        return ColumnError(("current",), -1.0, Reference.DRIVE, (SIGN,))
    return None
