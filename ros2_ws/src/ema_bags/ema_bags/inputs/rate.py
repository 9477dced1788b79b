# SPDX-License-Identifier: Apache-2.0
"""Estimation of the sample rate from time stamps."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

_COMMON: Final = sorted(
    {
        float(mantissa) * 10.0**power
        for mantissa in (1, 1.2, 1.25, 1.6, 2, 2.4, 2.5, 3, 4, 5, 6, 6.25, 7.5, 8)
        for power in range(-1, 6)
    }
    | {128.0, 256.0, 512.0, 1024.0, 2048.0, 4096.0, 8192.0}
)
_COMMON_WITHIN: Final = 2e-3
_LONGEST_REACH: Final = 256
_BURST: Final = 32
_EXACT: Final = 2e-4
_STILL: Final = 1e-3


@dataclass(frozen=True)
class Rate:
    """Sample rate and regularity of the stamps."""

    period: float
    """Nominal sample period [s]: the period of a common rate if the stamps match one."""
    measured_period: float
    """Sample period measured from the stamps [s]."""
    jitter: float
    """Robust standard deviation of the stamps from regular stamps [s]."""
    resolution: float
    """Resolution of the stamps [s]."""

    @property
    def is_regular(self) -> bool:
        """Whether samples are regular enough to be used without interpolation."""
        rounded = self.jitter <= 0.5 * self.resolution
        return (rounded or self.jitter <= _STILL * self.period) and abs(
            self.measured_period / self.period - 1.0
        ) <= _EXACT


def find_rate(stamps_ns: NDArray[np.int64], rate_hz: float = 0.0) -> Rate:
    """Estimate the sample rate from stamps with jitter, clock jumps and lost samples.

    Parameters
    ----------
    stamps_ns
        Stamps in the order of the samples, ``(n,)`` [ns].
    rate_hz
        Nominal rate [Hz]; 0 to estimate it.

    Raises
    ------
    ValueError
        If all stamps are equal or decreasing.
    """
    steps = np.diff(stamps_ns)
    steps = steps[steps > 0].astype(np.float64)
    if not len(steps):
        raise ValueError(
            f"the stamps of {len(stamps_ns)} samples do not increase: expected increasing stamps"
        )
    period = _first_period(stamps_ns, steps)
    # Each pass measures the period over a longer stretch without lost samples. The error decreases
    # with length, so the next pass can distinguish a longer period from a lost sample.
    reach = 2
    while reach <= min(_LONGEST_REACH, len(stamps_ns) - 1):
        spans = (stamps_ns[reach:] - stamps_ns[:-reach]).astype(np.float64)
        complete = spans[np.abs(spans - reach * period) < 0.45 * period]
        if len(complete) < max(1, len(spans) // 50):
            break
        period = (
            float(np.median(complete)) / reach if reach > 8 else float(np.mean(complete)) / reach
        )
        reach *= 2
    measured = period * 1e-9
    nominal = 1.0 / rate_hz if rate_hz else _common_period(measured)
    return Rate(
        nominal, measured, _jitter(stamps_ns, period) * 1e-9, resolution_of(stamps_ns) * 1e-9
    )


def _first_period(stamps_ns: NDArray[np.int64], steps: NDArray[np.float64]) -> float:
    typical = float(np.median(steps))
    reach = min(_BURST, len(stamps_ns) - 1)
    average = float(np.median(stamps_ns[reach:] - stamps_ns[:-reach])) / reach
    if average > 0.0 and not 0.7 < typical / average < 1.3:
        return average  # steps within bursts are not the period
    return float(np.mean(steps[(steps > 0.5 * typical) & (steps < 1.5 * typical)]))


def _common_period(period: float) -> float:
    """Return the period of a common rate, or else of whole hertz, within 0.2 % of ``period`` [s].

    If there is none, ``period`` is returned.
    """
    rate = 1.0 / period
    nearest = min(_COMMON, key=lambda item: abs(item / rate - 1.0))
    if abs(nearest / rate - 1.0) <= _COMMON_WITHIN:
        return 1.0 / nearest
    if round(rate) and abs(round(rate) / rate - 1.0) <= _COMMON_WITHIN:
        return 1.0 / round(rate)
    return period


def _jitter(stamps_ns: NDArray[np.int64], period_ns: float) -> float:
    """Return the robust standard deviation of the stamps around fitted regular stamps [ns]."""
    length = min(_LONGEST_REACH, len(stamps_ns))
    if length < 3:
        return 0.0
    count = len(stamps_ns) // length * length
    rows = (stamps_ns[:count].reshape(-1, length) - stamps_ns[:count:length, None]).astype(float)
    residuals = rows - period_ns * np.arange(length)
    residuals -= np.median(residuals, axis=1, keepdims=True)
    # The median over stretches rejects stretches with lost samples.
    return float(np.median(1.4826 * np.median(np.abs(residuals), axis=1)))


def resolution_of(stamps_ns: NDArray[np.int64]) -> float:
    """Return the resolution of the stamps, a power of ten [ns]."""
    offsets = stamps_ns - stamps_ns[0]
    resolution = 1
    while resolution < 1_000_000_000 and not np.any(offsets % (10 * resolution)):
        resolution *= 10
    return float(resolution)
