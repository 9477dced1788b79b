# SPDX-License-Identifier: Apache-2.0
"""Alignment of windows with the same command.

Noise or coarse steps in the measured command shift the sample at which motion is detected.
Therefore windows with the same command may begin some samples apart.
"""

from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ema_core.arrays import Array
from ema_monitor.windows.band import rms

COMMAND_TOLERANCE: Final = 5e-3
"""Largest rms difference between two commands that count as equal, relative to their rms [-]."""

MOST_SHIFT_S: Final = 6e-3
"""Largest offset between the starts of two windows with the same command [s]."""

_LEAST_SAMPLES: Final = 2

# Relative to the travel: far above rounding errors, far below the motion within a sample.
_SAME: Final = 1e-6


def shift_between(command: Array, reference: Array, sample_period: float) -> int:
    """Return the number of samples by which a window begins later than a reference.

    Parameters
    ----------
    command, reference
        Commands of the two windows, both ``(n,)`` [rad].
    sample_period
        Sample period of both windows [s].
    """
    if np.max(np.abs(command - reference)) <= _SAME * np.ptp(reference):
        return 0
    most = max(_LEAST_SAMPLES, round(MOST_SHIFT_S / sample_period))
    most = min(most, (len(command) - 1) // 2)
    shifts = np.array(sorted(range(-most, most + 1), key=abs))
    # The part of the reference that overlaps the command at every shift.
    middle = reference[most : len(reference) - most]
    counterparts = sliding_window_view(command, len(middle))[most - shifts]
    return int(shifts[np.argmin(np.mean((counterparts - middle) ** 2, axis=1))])


def difference_at(command: Array, reference: Array, shift: int) -> float:
    """Return the rms difference between two commands where they overlap [rad].

    Parameters
    ----------
    command, reference
        Commands of the two windows, both ``(n,)`` [rad].
    shift
        Number of samples by which the window begins later than the reference.
    """
    if shift < 0:
        command, reference, shift = reference, command, -shift
    return rms(command[: len(command) - shift] - reference[shift:])


def shift_if_same(command: Array, reference: Array, sample_period: float) -> int | None:
    """Return the shift between two windows with the same command [samples].

    The shift is positive if the window begins later than the reference. Returns None if the
    commands differ in length, or by more than `COMMAND_TOLERANCE` after alignment.

    Parameters
    ----------
    command, reference
        Commands of the two windows, of any lengths [rad].
    sample_period
        Sample period of both windows [s].
    """
    if len(command) != len(reference):
        return None
    shift = shift_between(command, reference, sample_period)
    is_same = difference_at(command, reference, shift) <= COMMAND_TOLERANCE * rms(reference)
    return shift if is_same else None


def moved(row: Array, shift: int) -> Array:
    """Return a row shifted by ``shift`` samples towards its start, ``(n,)``.

    Samples beyond the ends repeat the first or the last value.
    """
    n = len(row)
    return row[np.clip(np.arange(n) + shift, 0, n - 1)]
