# SPDX-License-Identifier: Apache-2.0
"""Detection of angles that wrap after a turn, or at the end of their register."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array

AROUND: Final = 8
"""Number of steps on each side with which a wrap is compared."""

_BITS: Final = (8, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 24, 32)
_LEAST_STEP: Final = 0.6
_MOST_STEP: Final = 1.4
_SLOW: Final = 0.2
_NEAR: Final = 0.02
_ALIKE: Final = 4.0
_FULL: Final = 0.9


def register_periods(highest: float) -> list[float]:
    """Return the ranges of registers [counts] that a largest reading nearly fills."""
    counts = (2.0**bits for bits in _BITS)
    return [n for n in counts if _FULL * n < highest < n]


def is_turn_apart(difference: float, turn: float) -> bool:
    """Return whether two readings of the same angle differ by slightly less than one turn."""
    return abs(difference) < turn and abs(difference) > (1.0 - _SLOW) * turn


def wraps_in(steps: Array, period: float, before: Array) -> NDArray[np.bool_]:
    """Return a mask of the steps that are wraps, ``(n,)``.

    A step of about one period is a wrap if the neighbouring steps are short and the step minus the
    period is similar to them.

    Parameters
    ----------
    steps
        Steps of the angle, ``(n,)``.
    period
        Size of a wrap.
    before
        Earlier steps with wraps removed, ``(m,)``.
    """
    sizes = np.abs(steps)
    wraps = (sizes > _LEAST_STEP * period) & (sizes < _MOST_STEP * period)
    if not np.any(wraps):
        return wraps
    all_sizes = np.concatenate([np.abs(before), sizes])
    are_usual = np.concatenate([np.ones(len(before), bool), ~wraps])
    for row in np.flatnonzero(wraps):
        at = row + len(before)
        around = slice(max(0, at - AROUND), at + AROUND + 1)
        usual = all_sizes[around][are_usual[around]]
        longest = float(np.max(usual, initial=0.0))
        remainder = abs(sizes[row] - period)
        wraps[row] = (
            len(usual) > 0
            and longest < _SLOW * period
            and remainder < _ALIKE * longest + _NEAR * period
        )
    return wraps
