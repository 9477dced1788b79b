# SPDX-License-Identifier: Apache-2.0
"""The wrong column of a window in SI units, from relations that no fault scales."""

from dataclasses import dataclass

from ema_core.columns.errors import ColumnError, Reference
from ema_core.columns.mistakes import PEAK_FOR_RMS, RMS_FOR_PEAK
from ema_core.columns.tolerances import (
    AMPLITUDE,
    WINDOW_FACTOR,
    WINDOW_INERTIA,
    WINDOW_TRACKING,
    is_beyond,
    is_within,
)


@dataclass(frozen=True)
class WindowRelations:
    """Relations between the columns of a window, ideally 1."""

    speed: float
    """Motor speed over the derivative of the position at the motor [-]."""
    tracking: float
    """Travel of the position over travel of the command [-]."""
    inertia: float | None
    """Apparent inertia, from current and acceleration, over the calibrated inertia [-]; None if
    unknown."""


def wrong_column_of_window(relations: WindowRelations, tau: float) -> ColumnError | None:
    """Return the error of the column that contradicts the others by a factor, or None.

    ``tau`` is the gear ratio, user over motor speed.
    """
    speed, tracking, inertia = relations.speed, relations.tracking, relations.inertia
    if is_beyond(speed, WINDOW_FACTOR):
        if is_beyond(tracking, WINDOW_TRACKING):
            return ColumnError.of(("position",), 1.0 / speed, Reference.SPEED, tau)
        # A wrong speed scales the apparent inertia by the inverse factor.
        if inertia is not None and is_within(inertia * speed, WINDOW_INERTIA):
            return ColumnError.of(("speed",), speed, Reference.POSITION, tau)
        return ColumnError.of(("position", "command"), 1.0 / speed, Reference.SPEED, tau)
    if is_beyond(tracking, WINDOW_TRACKING):
        return ColumnError.of(("command",), 1.0 / tracking, Reference.POSITION, tau)
    if inertia and is_beyond(inertia, WINDOW_FACTOR):
        return ColumnError.of(("current",), inertia, Reference.INERTIA, tau)
    return None


def wrong_amplitude(current: float) -> ColumnError | None:
    """Return the error of a current recorded as RMS instead of peak or vice versa, or None.

    ``current`` is the fitted gain of the measured current [-].
    """
    for mistake in (PEAK_FOR_RMS, RMS_FOR_PEAK):
        if is_within(current / mistake.factor, AMPLITUDE):
            return ColumnError(("current",), current, Reference.DRIVE, (mistake,))
    return None
