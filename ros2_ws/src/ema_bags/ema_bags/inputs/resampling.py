# SPDX-License-Identifier: Apache-2.0
"""Resampling to a fixed period, tolerating jitter, clock jumps and lost samples."""

from collections.abc import Iterator
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.filling import NEAR, GapFiller
from ema_bags.inputs.rate import Rate
from ema_core.telemetry import PAUSE_S, elapsed_ns


@dataclass
class Losses:
    """Counts of lost, dropped and corrected samples."""

    samples: int = 0
    """Samples received."""
    lost: int = 0
    """Samples missing in gaps."""
    gaps: int = 0
    """Gaps in which samples are missing."""
    filled: int = 0
    """Lost samples that were interpolated; not included in ``lost``."""
    pauses: int = 0
    """Interruptions of more than 1 s, which do not count as losses."""
    jumps: int = 0
    """Backward clock steps."""
    repeated: int = 0
    """Samples dropped because they repeat the previous stamp with different values."""
    duplicates: int = 0
    """Samples dropped because they repeat the previous stamp and values."""
    missing: int = 0
    """Samples dropped because a value is not finite."""
    impossible: int = 0
    """Physically impossible samples, which were replaced by interpolation or dropped."""
    wraps: int = 0
    """Angle register wraps that were removed."""
    reordered: int = 0
    """Samples that were out of order and sorted by stamp."""

    def __sub__(self, earlier: "Losses") -> "Losses":
        return Losses(
            *(count - before for count, before in zip(astuple(self), astuple(earlier), strict=True))
        )


@dataclass(frozen=True, eq=False)
class GaplessRun:
    """Consecutive samples at a fixed period, without gaps."""

    first_index: int
    """Index of the first sample."""
    stamps_ns: NDArray[np.int64]
    """Stamps, ``(n,)`` [ns]."""
    values: NDArray[np.float64]
    """Values, ``(n, m)``, one column per quantity."""


class Resampler:
    """Resamples time-stamped samples into gapless runs at a fixed period.

    Regular samples are returned unchanged; irregular samples are interpolated by stamp. A
    gap, a pause or a backward clock step ends a run. Indices start at 1 and skip the missing
    samples between runs, at least one.

    Parameters
    ----------
    rate
        Sample rate and jitter of the stamps.
    most_filled
        Largest number of consecutive lost samples to interpolate (see ``GapFiller``).
    motion
        Indices of the command and position columns, which ``GapFiller`` checks for reversals.
    nearest
        Indices of columns resampled to the nearest sample, because interpolation would smooth their
        noise.
    """

    def __init__(
        self,
        rate: Rate,
        most_filled: int = 0,
        motion: tuple[int, ...] = (),
        nearest: tuple[int, ...] = (),
    ) -> None:
        self.losses = Losses()
        self._rate = rate
        self._period_ns = rate.period * 1e9
        # A step of two periods is always a loss, regardless of jitter.
        self._widest_ns = 1e9 * min(
            1.9 * rate.period, max(1.5 * rate.period, rate.period + 5.6 * rate.jitter)
        )
        self._filler = (
            GapFiller(self._period_ns, self._widest_ns, most_filled, [*motion])
            if most_filled
            else None
        )
        self._nearest = [*nearest]
        self._index = 0
        self._last_ns: int | None = None
        self._last_values = np.empty(0)
        self._origin_ns = 0
        self._origin_index = 0
        self._next = 0

    def push(
        self, stamps_ns: NDArray[np.int64], values: NDArray[np.float64], *, is_last: bool = False
    ) -> list[GaplessRun]:
        """Add samples, in order, and return the completed runs.

        Parameters
        ----------
        stamps_ns
            Stamps of the samples, ``(n,)`` [ns].
        values
            Values of the samples, ``(n, m)``.
        is_last
            Whether these are the last samples.
        """
        self.losses.samples += len(stamps_ns)
        finite = np.all(np.isfinite(values), axis=1)
        self.losses.missing += int(np.count_nonzero(~finite))
        stamps_ns, values = stamps_ns[finite], values[finite]
        if self._filler and len(stamps_ns):
            stamps_ns, values = self._filler.push(stamps_ns, values, is_last=is_last)
            self.losses.filled = self._filler.filled
        resample = self._regular if self._rate.is_regular else self._between
        runs: list[GaplessRun] = []
        for stamps, part in self._increasing(stamps_ns, values):
            runs += resample(stamps, part)
        return runs

    def _increasing(
        self, stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Yield segments with increasing stamps, split at backward clock steps.

        Samples that repeat the previous stamp are counted and dropped.
        """
        nearest = NEAR * self._period_ns if self._rate.is_regular else 1.0
        while len(stamps_ns):
            first = stamps_ns[0] if self._last_ns is None else self._last_ns
            steps = np.diff(stamps_ns, prepend=np.int64(first))
            if self._last_ns is None:
                steps[0] = round(self._period_ns)
            repeated = np.abs(steps) < nearest
            if np.any(repeated):
                before = np.nan * values[0] if self._last_ns is None else self._last_values
                same = np.all(values == np.vstack([before, values[:-1]]), axis=1)
                self.losses.duplicates += int(np.count_nonzero(repeated & same))
                self.losses.repeated += int(np.count_nonzero(repeated & ~same))
                stamps_ns, values = stamps_ns[~repeated], values[~repeated]
                continue
            back = np.flatnonzero(steps < 0)
            stop = len(stamps_ns) if not len(back) else int(back[0])
            if stop:
                yield stamps_ns[:stop], values[:stop]
                self._last_values = values[stop - 1]
            if stop < len(stamps_ns):
                self.losses.jumps += 1
                self._last_ns = None
            stamps_ns, values = stamps_ns[stop:], values[stop:]

    def _regular(
        self, stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> list[GaplessRun]:
        """Return runs of the samples without interpolation."""
        before = stamps_ns[0] if self._last_ns is None else self._last_ns
        steps = np.diff(stamps_ns, prepend=np.int64(before)) / self._period_ns
        counts = np.maximum(np.rint(steps), 1.0).astype(np.int64)
        if self._last_ns is None:
            counts[0] = 2 if self._index else 1
        self._note_gaps(steps)
        return self._runs(self._index + np.cumsum(counts), stamps_ns, values, stamps_ns[-1])

    def _between(
        self, stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> list[GaplessRun]:
        """Return runs interpolated at regular times."""
        if self._last_ns is None:
            self._origin_ns, self._next = int(stamps_ns[0]), 0
            self._origin_index = self._index + (2 if self._index else 1)
        else:
            stamps_ns = np.concatenate([[self._last_ns], stamps_ns])
            values = np.concatenate([self._last_values[None], values])
        self._note_gaps(np.diff(stamps_ns) / self._period_ns)
        last = int((int(stamps_ns[-1]) - self._origin_ns) / self._period_ns + 1e-6)
        numbers = np.arange(self._next, last + 1)
        self._next = last + 1
        times = self._origin_ns + elapsed_ns(self._rate.period, 0, numbers)
        right = np.clip(np.searchsorted(stamps_ns, times), 0, len(stamps_ns) - 1)
        left = np.maximum(right - 1, 0)
        is_narrow = (stamps_ns[right] - stamps_ns[left] <= self._widest_ns) | (
            stamps_ns[right] == times
        )
        numbers, times = numbers[is_narrow], times[is_narrow]
        offsets = (stamps_ns - stamps_ns[0]).astype(float)
        at = (times - stamps_ns[0]).astype(float)
        resampled = np.column_stack([np.interp(at, offsets, column) for column in values.T])
        if self._nearest:
            left, right = left[is_narrow], right[is_narrow]
            row = np.where(at - offsets[left] < offsets[right] - at, left, right)
            resampled[:, self._nearest] = values[row][:, self._nearest]
        return self._runs(self._origin_index + numbers, times, resampled, stamps_ns[-1])

    def _runs(
        self,
        indices: NDArray[np.int64],
        stamps_ns: NDArray[np.int64],
        values: NDArray[np.float64],
        last_ns: np.int64,
    ) -> list[GaplessRun]:
        """Split the samples into runs of consecutive indices."""
        self._last_ns = int(last_ns)
        if not len(indices):
            return []
        self._index = int(indices[-1])
        parts = np.split(np.arange(len(indices)), np.flatnonzero(np.diff(indices) > 1) + 1)
        return [GaplessRun(int(indices[i[0]]), stamps_ns[i], values[i]) for i in parts]

    def _note_gaps(self, steps: NDArray[np.float64]) -> None:
        """Count pauses, gaps and lost samples; `steps` are stamp differences in periods."""
        wide = steps[steps * self._period_ns > self._widest_ns]
        is_pause = wide * self._rate.period > PAUSE_S
        self.losses.pauses += int(np.count_nonzero(is_pause))
        lost = wide[~is_pause]
        self.losses.gaps += len(lost)
        self.losses.lost += int(np.sum(np.rint(lost) - 1.0))
