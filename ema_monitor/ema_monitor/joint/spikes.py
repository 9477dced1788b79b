"""Removal of spikes of the effort: samples far outside its range, from sensor or bus errors."""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ema_core.arrays import Array
from ema_core.telemetry import Telemetry

_AROUND: Final = 5
"""Length of the running median in samples; spikes have at most two samples."""
_LEAST_EXCESS: Final = 0.5
"""Least excess of a spike over the range of the running median, as a share of the range [-]."""
_LEAST_DEPARTURE: Final = 8.0
"""Least departure of a spike from the running median, in standard deviations of the noise [-]."""
_COARSEST: Final = 0.1
"""Largest cut-off relative to the sample rate at which motion peaks differ from spikes [-]."""
_NEAR: Final = 25
"""Number of samples before and after a spike used to estimate the noise."""
_NORMAL: Final = 1.4826


class Despiked(NamedTuple):
    """Telemetry without spikes of the effort, and the number of replaced samples."""

    telemetry: Telemetry
    spikes: int


def despiked(telemetry: Telemetry, cutoff_hz: float) -> Despiked:
    """Return the telemetry with the running median in place of each spike of the effort.

    A reversal of friction, a stroke and quantisation are within the range of the running median.
    Telemetry is returned unchanged if it has no spikes, or if its rate is so low that peaks of the
    motion last one sample.

    Parameters
    ----------
    telemetry
        The record.
    cutoff_hz
        Cut-off frequency of the motion [Hz].

    Notes
    -----
    Test against the median and the median absolute deviation of the neighbours (Hampel, 1974).
    """
    effort = telemetry.current
    if len(effort) < _AROUND or telemetry.sample_period * cutoff_hz > _COARSEST:
        return Despiked(telemetry, 0)
    median = _running_median(effort)
    lowest, highest = float(np.min(median)), float(np.max(median))
    excess = _LEAST_EXCESS * (highest - lowest)
    far = np.flatnonzero((effort < lowest - excess) | (effort > highest + excess))
    departure = effort - median
    spikes = [at for at in far.tolist() if _is_spike(departure, at)]
    if not spikes:
        return Despiked(telemetry, 0)
    current = effort.copy()
    current[spikes] = median[spikes]
    return Despiked(replace(telemetry, current=current), len(spikes))


def _running_median(values: Array) -> Array:
    """Return the running median; ends are padded with the end values."""
    sides = _AROUND // 2
    around = sliding_window_view(np.pad(values, sides, mode="edge"), _AROUND)
    return np.sort(around, axis=1)[:, sides]


def _is_spike(departure: Array, at: int) -> bool:
    """Return whether a sample departs from the running median by more than the noise near it."""
    near = departure[max(0, at - _NEAR) : at + _NEAR + 1]
    noise = _NORMAL * float(np.median(np.abs(near)))
    return bool(abs(departure[at]) > _LEAST_DEPARTURE * noise)
