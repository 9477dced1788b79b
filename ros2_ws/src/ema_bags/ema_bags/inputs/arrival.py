# SPDX-License-Identifier: Apache-2.0
"""Reconstruction of time stamps from arrival times."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

_SPAN_S: Final = 5.0
_SETTLE_NS: Final = 200_000_000
_SETTLE_LEAST: Final = 8
_LOST: Final = 0.6
_PERIOD_SIGMA: Final = 1e-3
_PAUSE_NS: Final = 1_000_000_000
_REWEIGHTS: Final = 8


class ArrivalClock:
    """Reconstructs the stamps of regular samples by regressing arrival times on sample numbers.

    A robust line over the last 5 s averages out transport delays. Samples are assumed to arrive in
    order. A stalled queue is assumed to drain within 0.2 s of its first late sample; samples that
    stay late for longer follow a loss. A stamp is therefore final once the next 0.2 s of samples,
    and at least eight, have arrived.

    Parameters
    ----------
    period
        Sample period, accurate to 0.1 % [s].

    Attributes
    ----------
    rebuilt
        Number of stamps reconstructed so far.
    early_s
        How much earlier than the line the latest samples arrived [s]; more than the jitter shows
        that samples come faster than the period.
    """

    def __init__(self, period: float) -> None:
        self.rebuilt = 0
        self.early_s = 0.0
        self._period = period * 1e9
        self._settle = max(_SETTLE_LEAST, round(1e-9 * _SETTLE_NS / period))
        self._span = max(4 * self._settle, round(_SPAN_S / period))
        self._restart()
        self._waiting = np.empty(0, dtype=np.int64)

    def push(self, arrivals_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Add arrival times, ``(n,)`` [ns], and return the stamps that became final [ns].

        Stamps are returned in order of arrival, with gaps where samples were lost.
        """
        self._waiting = np.concatenate([self._waiting, arrivals_ns])
        count = self._count()
        # To save time, the line is fitted for several samples at once.
        return self._settled(count if count >= self._settle // 2 else 0)

    def flush(self) -> NDArray[np.int64]:
        """Return the stamps of all remaining samples [ns]."""
        return self._settled(len(self._waiting))

    def _count(self) -> int:
        """Return the number of samples that are followed by at least 0.2 s and eight samples."""
        elapsed = _elapsed(self._waiting)
        count = int(np.searchsorted(elapsed, elapsed[-1] - _SETTLE_NS)) if len(elapsed) else 0
        return min(count, len(elapsed) - _SETTLE_LEAST)

    def _restart(self) -> None:
        self._numbers = np.empty(0)
        self._arrivals = np.empty(0)
        self._origin_ns = 0
        self._next = 0.0
        self._line_before: tuple[float, float] | None = None

    def _settled(self, count: int) -> NDArray[np.int64]:
        """Return the stamps of the first ``count`` waiting samples [ns].

        They are computed part by part, so that the line can follow clock drift.
        """
        parts = [np.empty(0, dtype=np.int64)]
        while count > 0:
            part = min(count, self._settle * 4)
            parts.append(self._settle_part(part))
            count -= part
        stamps = np.concatenate(parts)
        self.rebuilt += len(stamps)
        return stamps

    def _settle_part(self, count: int) -> NDArray[np.int64]:
        elapsed = _elapsed(self._waiting)
        end = int(np.searchsorted(elapsed, elapsed[count - 1] + _SETTLE_NS, "right"))
        ahead = self._waiting[: max(end, count + _SETTLE_LEAST)]
        last = self._origin_ns + self._arrivals[-1] if len(self._arrivals) else ahead[0]
        steps = np.diff(ahead[:count], prepend=np.int64(last))
        breaks = np.flatnonzero(np.abs(steps) > _PAUSE_NS)
        if len(breaks) and breaks[0] == 0:
            self._restart()
            breaks = breaks[1:]
        if len(breaks):
            # Samples after a pause get a separate line.
            count = int(breaks[0])
            ahead = ahead[:count]
        if not len(self._numbers):
            self._origin_ns = int(ahead[0])
        arrivals = (ahead - self._origin_ns).astype(float)
        numbers = self._with_losses(self._next + np.arange(len(ahead), dtype=float), arrivals)
        self._numbers = np.concatenate([self._numbers, numbers[:count]])[-self._span :]
        self._arrivals = np.concatenate([self._arrivals, arrivals[:count]])[-self._span :]
        # Include later samples: at the start, all earlier ones may come from a stalled queue.
        offset, slope = self._line(
            np.concatenate([self._numbers, numbers[count:]]),
            np.concatenate([self._arrivals, arrivals[count:]]),
        )
        early = offset + slope * numbers - arrivals
        self.early_s = 1e-9 * float(np.min(early[-_SETTLE_LEAST:]))
        self._next = numbers[count - 1] + 1.0
        self._waiting = self._waiting[count:]
        stamps = offset + slope * numbers[:count]
        if self._line_before is not None:
            # Spread the shift of the line over the part, as a sudden step would look like a gap.
            before, slope_before = self._line_before
            move = stamps[0] - (before + slope_before * numbers[0])
            stamps -= move * np.linspace(1.0, 0.0, count + 1)[1:]
        self._line_before = offset, slope
        return self._origin_ns + np.rint(stamps).astype(np.int64)

    def _with_losses(
        self, numbers: NDArray[np.float64], arrivals: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return sample numbers that skip lost samples."""
        is_known = len(self._numbers) >= self._settle
        x, y = (self._numbers, self._arrivals) if is_known else (numbers, arrivals)
        offset, slope = self._line(x, y)
        usual = float(np.quantile(y - (offset + slope * x), 0.1))
        while True:
            late = (arrivals - (offset + slope * numbers) - usual) / slope
            # Smallest lateness of this and all later samples; if it persists, samples were lost.
            least = np.minimum.accumulate(late[::-1])[::-1]
            lasting = np.flatnonzero(least[: max(1, len(least) - _SETTLE_LEAST + 1)] > _LOST)
            if not len(lasting):
                return numbers
            first = int(lasting[0])
            numbers = numbers.copy()
            numbers[first:] += max(1.0, float(np.rint(least[first])))

    def _line(
        self, numbers: NDArray[np.float64], arrivals: NDArray[np.float64]
    ) -> tuple[float, float]:
        """Fit a robust line to arrival times; return its offset and slope [ns].

        Iteratively reweighted with Huber and then Tukey weights. A prior of 0.1 % on the slope
        keeps the fit stable at the start, when most samples may come from two stalled queues.
        """
        middle = numbers.mean()
        x, y = numbers - middle, arrivals - self._period * numbers
        tilt, offset = 0.0, float(np.median(y))
        for number in range(_REWEIGHTS):
            residuals = y - offset - tilt * x
            scale = max(1.4826 * float(np.median(np.abs(residuals))), 1.0)
            deviations = np.maximum(np.abs(residuals) / scale, 1e-9)
            weights = np.minimum(1.0, 1.345 / deviations)
            if number >= _REWEIGHTS // 2:
                # The line is close enough to reject samples from a stalled queue.
                weights = np.maximum(1.0 - (deviations / 4.685) ** 2, 0.0) ** 2
            mean_x = np.average(x, weights=weights)
            mean_y = np.average(y, weights=weights)
            prior = (scale / (_PERIOD_SIGMA * self._period)) ** 2
            spread = prior + np.sum(weights * (x - mean_x) ** 2)
            tilt = float(np.sum(weights * (x - mean_x) * (y - mean_y)) / spread)
            offset = float(mean_y - tilt * mean_x)
        return offset - tilt * middle, self._period + tilt


def _elapsed(arrivals_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the time since the first arrival [ns]; backward clock steps count as zero."""
    return np.cumsum(np.maximum(np.diff(arrivals_ns, prepend=arrivals_ns[:1]), 0))
