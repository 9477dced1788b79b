# SPDX-License-Identifier: Apache-2.0
"""Interpolation in short gaps during which the motion does not reverse."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.telemetry import PAUSE_S

NEAR: Final = 0.3
"""Share of the period within which two samples count as the same sample [-]."""

_STILL: Final = 0.1
_SCATTERS: Final = 2.0


class GapFiller:
    """Interpolates lost samples linearly, except where the motion reverses.

    The motion reverses if the command or position moves in both directions within the three steps
    around a gap. Each movement must exceed a tenth of the mean speed so far and twice the mean
    change between steps (the noise). Gaps longer than 1 s are pauses and are not filled.

    Parameters
    ----------
    period_ns, widest_ns
        Sample period, and longest step that does not count as a gap [ns].
    most
        Largest number of consecutive lost samples that are filled.
    columns
        Indices of the command and position columns.

    Attributes
    ----------
    filled
        Number of samples added so far.
    """

    def __init__(self, period_ns: float, widest_ns: float, most: int, columns: list[int]) -> None:
        self.filled = 0
        self._period_ns, self._widest_ns = period_ns, widest_ns
        self._most, self._columns = most, columns
        # The latest samples, and how many of them have been returned.
        self._stamps_ns, self._values = np.empty(0, dtype=np.int64), np.empty((0, 0))
        self._passed = 0
        # Sums of the speeds of the steps so far, and of the changes between steps.
        self._travelled = self._changed = np.zeros(len(columns))
        self._steps = 0

    def push(
        self, stamps_ns: NDArray[np.int64], values: NDArray[np.float64], *, is_last: bool
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return stamps, ``(n,)`` [ns], and values, ``(n, m)``, with lost samples interpolated.

        The sample after a gap is held back until the next sample shows whether the motion reverses.
        ``is_last`` releases it.
        """
        first_new = max(len(self._stamps_ns) - 1, 0)
        if len(self._stamps_ns):
            stamps_ns = np.concatenate([self._stamps_ns, stamps_ns])
            values = np.concatenate([self._values, values])
        steps = np.diff(stamps_ns) / self._period_ns
        lost = np.rint(steps).astype(np.int64) - 1
        widths_ns = steps * self._period_ns
        is_short = (widths_ns > self._widest_ns) & (widths_ns <= 1e9 * PAUSE_S)
        is_short &= lost <= self._most
        reverses = self._reversals(steps, values[:, self._columns], first_new)
        gaps = 1 + np.flatnonzero(is_short[1:-1] & ~reverses)
        gaps = gaps[gaps + 1 >= self._passed]
        before = np.repeat(gaps, lost[gaps])
        part = np.concatenate([[], *(np.arange(1, n + 1) / (n + 1) for n in lost[gaps])])
        times = stamps_ns[before] + np.rint(part * self._period_ns * steps[before])
        added = values[before] + part[:, None] * (values[before + 1] - values[before])
        self.filled += len(before)
        end = len(stamps_ns) - int(np.any(is_short[-1:]) and not is_last)
        passed, self._passed = self._passed, min(2, end)
        first = end - self._passed
        self._stamps_ns, self._values = stamps_ns[first:], values[first:]
        return (
            np.insert(stamps_ns[:end], before + 1, times.astype(np.int64))[passed:],
            np.insert(values[:end], before + 1, added, axis=0)[passed:],
        )

    def _reversals(
        self, steps: NDArray[np.float64], motion: NDArray[np.float64], first_new: int
    ) -> NDArray[np.bool_]:
        """Return, for each interior step, whether the motion reverses there."""
        is_step = (steps > NEAR)[:, None]
        speeds = np.where(is_step, np.diff(motion, axis=0), 0.0)
        speeds /= np.where(is_step, steps[:, None], 1.0)
        # The sums include the earlier steps, and the changes between them.
        is_new = np.arange(len(speeds)) >= first_new
        travelled = self._travelled + np.cumsum(np.abs(speeds) * is_new[:, None], axis=0)
        changes = np.abs(np.diff(speeds, axis=0, prepend=speeds[:1]))
        changed = self._changed + np.cumsum(changes * is_new[:, None], axis=0)
        counts = self._steps + np.cumsum(is_new)
        if len(speeds):
            self._travelled, self._changed = travelled[-1], changed[-1]
            self._steps = int(counts[-1])
        sums = np.maximum(_STILL * travelled, _SCATTERS * changed)
        least = sums[2:] / counts[2:, None]
        around = np.array([speeds[:-2], speeds[1:-1], speeds[2:]])
        moves_back, moves_forth = np.min(around, axis=0) < -least, np.max(around, axis=0) > least
        return np.any(moves_back & moves_forth, axis=1)
