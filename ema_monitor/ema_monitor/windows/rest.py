# SPDX-License-Identifier: Apache-2.0
"""Detection of rest from a position signal, independent of sensor resolution and noise."""

from collections import deque
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array, Flags

BINS_AT_ONCE: Final = 25
"""Number of bins that are processed together; larger values delay decisions."""

BIN_S: Final = 0.04
"""Length of a bin [s], unless the sample period is longer."""

_SMALLEST_THRESHOLD: Final = 2e-5
# Not an integer: positions differ by multiples of the resolution, or of a simple fraction of it.
_STEPS: Final = 4.29
_SIGMAS: Final = 8.0
_FOURTH_DIFFERENCE_GAIN: Final = 70.0**0.5
_NOISE_S: Final = 0.25
_NOISE_SAMPLES: Final = 25
_NOISE_WINDOWS: Final = 64
# Rounding errors of a position are not a resolution.
_RELATIVE_ROUNDING: Final = 1e-9


class PositionBin(NamedTuple):
    """Mean position over consecutive samples, and the threshold of rest."""

    first: int
    """Running index of the first sample."""
    last: int
    """Running index of the last sample."""
    position: float
    """Mean position [rad]."""
    threshold: float
    """Largest travel that sensor resolution and noise can explain [rad]."""


class PositionBins:
    """Reduces positions to bins of 40 ms, and estimates the resolution and noise of the sensor.

    The bins are aligned to the running index, so that the size of blocks has no effect.

    - The resolution is the smallest step between two samples so far.
    - The noise is the lower quartile of the RMS fourth differences in the latest 64 intervals of
      0.25 s. Motion contributes little to a fourth difference; rest and constant speed contribute
      nothing.

    Parameters
    ----------
    sample_period
        Sample period [s].
    first_index
        Running index of the first sample.

    Attributes
    ----------
    size
        Number of samples in a bin.
    next_index
        Running index of the first sample after the last bin.
    """

    def __init__(self, sample_period: float, first_index: int) -> None:
        self.size = max(1, int(BIN_S / sample_period * (1.0 + 1e-9)))
        self._noise_samples = max(_NOISE_SAMPLES, round(_NOISE_S / sample_period))
        self.next_index = first_index
        # Positions, and whether they are interpolated.
        self._pending: list[tuple[Array, Flags]] = []
        self._pending_count = 0
        self._previous = np.empty(0), np.empty(0, dtype=bool)
        self._resolution = np.inf
        self._power = self._power_count = 0.0
        self._noises: deque[float] = deque(maxlen=_NOISE_WINDOWS)
        self._noise = 0.0

    def add(self, position: Array, interpolated: Flags) -> list[PositionBin]:
        """Return the bins that the next positions complete; bins are completed in groups.

        Parameters
        ----------
        position
            Positions, ``(n,)`` [rad].
        interpolated
            Flags of interpolated positions, ``(n,)``, or ``(0,)`` without interpolated positions.
            Steps to interpolated positions do not count for the resolution.
        """
        flags = interpolated if len(interpolated) else np.zeros(len(position), dtype=bool)
        self._pending.append((position, flags))
        self._pending_count += len(position)
        whole = (self.next_index + self._pending_count) // self.size * self.size - self.next_index
        return self._reduce(whole) if whole >= BINS_AT_ONCE * self.size else []

    def finish(self) -> list[PositionBin]:
        """Return the bins of the remaining positions; the last bin may be shorter."""
        return self._reduce(self._pending_count) if self._pending_count else []

    def _reduce(self, count: int) -> list[PositionBin]:
        pending, interpolated = map(np.concatenate, zip(*self._pending, strict=True))
        self._pending = [(pending[count:], interpolated[count:])]
        self._pending_count -= count
        position = pending[:count]
        first = self.next_index
        starts = np.arange(-(first % self.size), count, self.size)
        starts[0] = 0
        lengths = np.append(starts[1:], count) - starts
        means = np.add.reduceat(position, starts) / lengths
        before, flags_before = self._previous
        joined = np.concatenate([before, position])
        flags = np.concatenate([flags_before, interpolated[:count]])
        self._previous = joined[-4:], flags[-4:]
        differences = joined[1:] - joined[:-1]
        steps = np.abs(differences)
        steps[flags[1:] | flags[:-1]] = np.inf
        steps = _aligned(steps, count)
        steps[steps <= _RELATIVE_ROUNDING * np.abs(position)] = np.inf
        fourth = differences
        for _ in range(3):
            fourth = fourth[1:] - fourth[:-1]
        powers = np.add.reduceat(_aligned(fourth**2, count), starts)
        counts = np.add.reduceat(_aligned(np.ones(len(fourth)), count), starts)
        smallest = np.minimum.reduceat(steps, starts)
        bins = []
        columns = (array.tolist() for array in (starts, lengths, means, smallest, powers, counts))
        for start, length, mean, step, power, power_count in zip(*columns, strict=True):
            self._resolution = min(self._resolution, step)
            self._measure_noise(power, power_count)
            begin = first + start
            bins.append(PositionBin(begin, begin + length - 1, mean, self._threshold()))
        self.next_index += count
        return bins

    def _measure_noise(self, power: float, count: float) -> None:
        self._power += power
        self._power_count += count
        if self._power_count >= self._noise_samples:
            self._noises.append((self._power / self._power_count) ** 0.5 / _FOURTH_DIFFERENCE_GAIN)
            self._noise = sorted(self._noises)[len(self._noises) // 4]
            self._power = self._power_count = 0.0

    def _threshold(self) -> float:
        resolution = self._resolution if self._resolution < np.inf else 0.0
        return max(_SMALLEST_THRESHOLD, _STEPS * resolution, _SIGMAS * self._noise)


class SteadyRun:
    """Longest run of bins, up to the latest bin, whose positions differ by at most a threshold.

    Attributes
    ----------
    begin
        Running index of the first sample of the run.
    """

    def __init__(self, first_index: int) -> None:
        self.begin = first_index
        # Index after a bin, and its position. The first entry is the lowest or highest of the run.
        self._lows: deque[tuple[int, float]] = deque()
        self._highs: deque[tuple[int, float]] = deque()

    @property
    def travel(self) -> float:
        """Difference between the highest and lowest position of the run [rad]."""
        return self._highs[0][1] - self._lows[0][1]

    def add(self, item: PositionBin, threshold: float, longest: int) -> None:
        """Add the next bin, and limit the run to ``longest`` samples."""
        entry = item.last + 1, item.position
        while self._lows and self._lows[-1][1] >= item.position:
            self._lows.pop()
        self._lows.append(entry)
        while self._highs and self._highs[-1][1] <= item.position:
            self._highs.pop()
        self._highs.append(entry)
        if (begin := item.last + 1 - longest) > self.begin:
            self._begin_at(begin)
        while self._highs[0][1] - self._lows[0][1] > threshold:
            self._begin_at(min(self._lows[0][0], self._highs[0][0]))

    def _begin_at(self, index: int) -> None:
        self.begin = index
        for extremes in (self._lows, self._highs):
            while extremes[0][0] <= index:
                extremes.popleft()


def _aligned(values: Array, count: int) -> Array:
    """Return the last ``count`` values, padded with leading zeros."""
    if len(values) >= count:
        return values[len(values) - count :]
    return np.concatenate([np.zeros(count - len(values)), values])
