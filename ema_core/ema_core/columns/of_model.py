# SPDX-License-Identifier: Apache-2.0
"""The error of a column, compared with the response of the described actuator."""

from ema_core.columns.errors import ColumnError, Reference, UnrelatedColumn
from ema_core.columns.tolerances import NEAR_MODEL, RELATED, is_within


def wrong_column_of_model(
    column: str, ratio: float, correlation: float, tau: float
) -> ColumnError | UnrelatedColumn | None:
    """Return the error of a column relative to the response of a healthy actuator, or None.

    The tolerance is wide, because a wrong column cannot be separated from a wrong parameter.

    Parameters
    ----------
    ratio
        Slope of the column over the response [-].
    correlation
        Correlation of column and response [-].
    tau
        Gear ratio, user over motor speed [-].
    """
    if abs(correlation) < RELATED:
        return UnrelatedColumn(column, correlation)
    if is_within(ratio, NEAR_MODEL):
        return None
    return ColumnError.of((column,), ratio, Reference.MODEL, tau)
