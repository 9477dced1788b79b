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

    The motion reverses if command or position move in both directions in the three steps around a
    gap, each faster than a tenth of the mean speed so far and than twice the mean change between
    steps, which is noise. A gap longer than 1 s is a pause, and is not filled.

    Parameters
    ----------
    period_ns, widest_ns
        Period of the samples, and the longest step that is not a gap [ns].
    most
        Largest number of consecutive lost samples that are filled.
    columns
        Indices of the columns of command and position.

    Attributes
    ----------
    filled
        Number of samples added so far.
    """

    def __init__(self, period_ns: float, widest_ns: float, most: int, columns: list[int]) -> None:
        self.filled = 0
        self._period_ns, self._widest_ns = period_ns, widest_ns
        self._most, self._columns = most, columns
        # The latest samples, and the number of them that were returned.
        self._stamps_ns, self._values = np.empty(0, dtype=np.int64), np.empty((0, 0))
        self._passed = 0
        # Sums of the speeds of the steps so far, and of the changes between steps.
        self._travelled = self._changed = np.zeros(len(columns))
        self._steps = 0

    def push(
        self, stamps_ns: NDArray[np.int64], values: NDArray[np.float64], *, is_last: bool
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return samples, ``(n,)`` [ns] and ``(n, m)``, with interpolated lost samples.

        A sample after a gap is returned together with the next sample, which shows whether the
        motion reverses, unless ``is_last`` is set.
        """
        begun = max(len(self._stamps_ns) - 1, 0)
        if len(self._stamps_ns):
            stamps_ns = np.concatenate([self._stamps_ns, stamps_ns])
            values = np.concatenate([self._values, values])
        steps = np.diff(stamps_ns) / self._period_ns
        lost = np.rint(steps).astype(np.int64) - 1
        widths_ns = steps * self._period_ns
        is_short = (widths_ns > self._widest_ns) & (widths_ns <= 1e9 * PAUSE_S)
        is_short &= lost <= self._most
        reverses = self._reversals(steps, values[:, self._columns], begun)
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
        self, steps: NDArray[np.float64], motion: NDArray[np.float64], begun: int
    ) -> NDArray[np.bool_]:
        """Return whether the motion reverses, for each step except the first and the last."""
        is_step = (steps > NEAR)[:, None]
        speeds = np.where(is_step, np.diff(motion, axis=0), 0.0)
        speeds /= np.where(is_step, steps[:, None], 1.0)
        # The sums include the earlier steps, and the changes between them.
        new = np.arange(len(speeds)) >= begun
        travelled = self._travelled + np.cumsum(np.abs(speeds) * new[:, None], axis=0)
        changes = np.abs(np.diff(speeds, axis=0, prepend=speeds[:1]))
        changed = self._changed + np.cumsum(changes * new[:, None], axis=0)
        counts = self._steps + np.cumsum(new)
        if len(speeds):
            self._travelled, self._changed = travelled[-1], changed[-1]
            self._steps = int(counts[-1])
        sums = np.maximum(_STILL * travelled, _SCATTERS * changed)
        least = sums[2:] / counts[2:, None]
        around = np.array([speeds[:-2], speeds[1:-1], speeds[2:]])
        moves_back, moves_forth = np.min(around, axis=0) < -least, np.max(around, axis=0) > least
        return np.any(moves_back & moves_forth, axis=1)
