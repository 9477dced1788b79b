# SPDX-License-Identifier: Apache-2.0
"""Detection of columns that repeat values because they are updated more slowly than sampled."""

from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_core.columns.errors import HeldColumn

_LEAST_CHANGES: Final = 20
_EARLY: Final = 10.0
_LOOSE_FROM: Final = 5
_REGULAR: Final = 0.9
_USUAL: Final = 0.5
_ONE_COUNT: Final = 1.5
# Steps of a coarse encoder may be up to two counts.
_COUNTS: Final = 2.5
# Largest ratio of the speeds computed from two successive updates in steady motion.
_STEADY: Final = 2.0
_REPEATED: Final = 0.05
_LONGEST: Final = 99.5


def held_samples(values: Array) -> int:
    """Return the number of samples for which a column, ``(n,)``, repeats each value.

    Returns 1 if the column does not repeat values, and 0 if it has too few changes to decide. A
    coarse encoder also repeats its value, but changes by one count at a time, less often at lower
    speed. A slowly updated column changes at multiples of a fixed period, by any amount.
    """
    finite = values[np.isfinite(values)]
    steps = np.diff(finite)
    rows = np.flatnonzero(steps)
    if len(rows) < _LEAST_CHANGES:
        return 0
    gaps = np.diff(rows)
    held = int(np.percentile(gaps, _EARLY))
    sizes = np.abs(steps[rows])
    if held < 2 or np.mean(sizes < _ONE_COUNT * np.min(sizes)) > _USUAL:
        return 1
    # Publisher and source have separate clocks: allow for one sample more or less.
    loose = 1 if held >= _LOOSE_FROM else 0
    typical = gaps[np.abs(gaps - np.median(gaps)) <= loose]
    held = round(float(np.mean(typical)))
    offset = np.abs(gaps - held * np.maximum(np.rint(gaps / held), 1.0))
    is_held = np.mean(offset <= loose) > _REGULAR and len(typical) > _USUAL * len(gaps)
    return held if is_held else 1


class IrregularUpdates(NamedTuple):
    """Number of samples per update of a column that is updated irregularly."""

    mean: float
    """Mean number of samples per update during motion."""
    longest: int
    """Number of samples per update that 99.5 % of the updates during motion do not exceed."""


def irregular_updates(values: Array) -> IrregularUpdates | None:
    """Return the update statistics of a column, ``(n,)``, that repeats values irregularly.

    Returns None if it does not. After repeated values, the next update catches up with a motion of
    unchanged speed. A coarse encoder instead changes by a single count, and after a pause in the
    motion there is nothing to catch up.
    """
    finite = values[np.isfinite(values)]
    steps = np.diff(finite)
    rows = np.flatnonzero(steps)
    if len(rows) < _LEAST_CHANGES:
        return None
    changes, gaps = steps[rows[1:]], np.diff(rows)
    is_large = np.abs(changes) > _COUNTS * np.min(np.abs(steps[rows]))
    speeds = changes / gaps
    ratios = speeds[1:] / speeds[:-1]
    is_steady = is_large[1:] & is_large[:-1] & (ratios > 1.0 / _STEADY) & (ratios < _STEADY)
    moving = gaps[1:][is_steady]
    if len(moving) < _LEAST_CHANGES or 1.0 - len(moving) / np.sum(moving) < _REPEATED:
        return None
    return IrregularUpdates(float(np.mean(moving)), int(np.ceil(np.percentile(moving, _LONGEST))))


def held_column(column: str, values: Array) -> HeldColumn | None:
    """Return the error of a column, ``(n,)``, that repeats its values, or None.

    The result is None also if the column has too few changes to decide.
    """
    if (held := held_samples(values)) > 1:
        return HeldColumn(column, float(held), held, is_regular=True)
    irregular = irregular_updates(values)
    if irregular is None:
        return None
    return HeldColumn(column, irregular.mean, irregular.longest, is_regular=False)


def between_renewals(values: Array, held: int) -> Array:
    """Return a column, ``(n,)``, interpolated linearly between the samples that update it.

    Parameters
    ----------
    values
        The column, without NaN.
    held
        Number of samples per update, ``longest`` of `held_column`.
    """
    renewed = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    # After a rest, the last update is `held` samples before the value changes.
    ends = renewed[1:] - held
    rested = ends[ends > renewed[:-1]]
    rows = np.unique(np.concatenate([renewed, rested]))
    result: Array = np.interp(np.arange(len(values)), rows, values[rows])
    return result
