# SPDX-License-Identifier: Apache-2.0
"""Detection of columns that are constant although other columns show motion."""

from collections.abc import Iterable
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_core.columns.errors import FrozenColumn

_COUNTERPARTS: Final = {"position": "speed", "speed": "position"}


def frozen_column(column: str, values: Array, moving: Iterable[str]) -> FrozenColumn | None:
    """Return the error of a column that is constant although other columns show motion, or None.

    If the shaft is blocked, position and speed are both rightly constant. A constant position is
    therefore an error only if the speed shows motion, and vice versa.

    Parameters
    ----------
    column, values
        Name of the column, and its values, ``(n,)``.
    moving
        Names of the columns that show motion; the error states the first other column.
    """
    evidence = [name for name in moving if name != column]
    if not evidence or _COUNTERPARTS.get(column, evidence[0]) not in evidence:
        return None
    finite = values[np.isfinite(values)]
    if not len(finite) or np.ptp(finite) > 0.0:
        return None
    return FrozenColumn(column, float(finite[0]), evidence[0], len(finite))
