# SPDX-License-Identifier: Apache-2.0
"""Errors of columns, compared with the healthy records of the unit."""

from ema_core.columns.errors import ColumnError, Reference
from ema_core.columns.mistakes import usual_mistake
from ema_core.columns.tolerances import (
    RECORD_EFFORT,
    RECORD_EFFORT_BY_FRICTION,
    RECORD_SPEED,
    RECORD_UPDATES,
    is_beyond,
)


def wrong_speed_of_record(column: str, factor: float, tau: float) -> ColumnError | None:
    """Return the error of position or speed in a record, or None.

    Only the factor of a common mistake is an error, because a motion may be slower or faster than
    the motions of the healthy records.

    Parameters
    ----------
    column
        Column that gives the speed: position or speed.
    factor
        Usual speed of the record over the usual speed of the healthy records [-].
    tau
        Gear ratio, user over motor speed [-].
    """
    if not is_beyond(factor, RECORD_SPEED):
        return None
    mistake = usual_mistake(column, factor, tau)
    return ColumnError((column,), factor, Reference.RECORDS, (mistake,)) if mistake else None


def wrong_effort_of_record(
    friction: float, inertia: float | None, tau: float
) -> ColumnError | None:
    """Return the error of an effort that has a different unit than the healthy records, or None.

    Parameters
    ----------
    friction, inertia
        Ratio to the healthy value [-]; the inertia is None if it is unknown. Friction gives the
        factor, because it is more accurate.
    tau
        Gear ratio, user over motor speed [-].
    """
    ratios = [friction] if inertia is None else [friction, inertia]
    highest = RECORD_EFFORT_BY_FRICTION if inertia is None else RECORD_EFFORT
    if not (
        all(ratio > highest for ratio in ratios)
        or all(ratio < 1.0 / RECORD_EFFORT for ratio in ratios)
    ):
        return None
    mistake = usual_mistake("current", friction, tau)
    return ColumnError(("current",), friction, Reference.RECORDS, (mistake,) if mistake else ())


def has_other_updates(per_update: float, healthy: float) -> bool:
    """Return whether the samples per update of a record differ clearly from the healthy records."""
    return is_beyond(per_update / healthy, RECORD_UPDATES)
