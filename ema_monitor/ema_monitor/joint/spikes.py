# SPDX-License-Identifier: Apache-2.0
"""Removal of effort spikes: samples far outside the usual range, from sensor or bus errors."""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ema_core.arrays import Array
from ema_core.telemetry import Telemetry

_AROUND: Final = 5
"""Length of the running median in samples; spikes have at most two samples."""
_LEAST_EXCESS: Final = 0.5
"""Smallest excess of a spike over the range of the running median, relative to the range [-]."""
_LEAST_DEPARTURE: Final = 8.0
"""Smallest distance of a spike from the running median, in standard deviations of the noise [-]."""
_COARSEST: Final = 0.1
"""Largest ratio of cut-off to sample rate at which motion peaks and spikes are distinguishable [-].
"""
_NEAR: Final = 25
"""Number of samples before and after a spike used to estimate the noise."""
_NORMAL: Final = 1.4826


class Despiked(NamedTuple):
    """Telemetry without effort spikes, and the number of replaced samples."""

    telemetry: Telemetry
    spikes: int


def despiked(telemetry: Telemetry, cutoff_hz: float) -> Despiked:
    """Return telemetry with each effort spike replaced by the running median.

    Friction reversals, strokes and quantisation stay within the range of the running median.
    Telemetry is returned unchanged if it has no spikes, or if its sample rate is so low that a peak
    of the motion lasts only one sample.

    Parameters
    ----------
    telemetry
        The record.
    cutoff_hz
        Cut-off frequency of the motion [Hz].

    Notes
    -----
    Hampel filter (Hampel, 1974): a sample is tested against the median and the median absolute
    deviation of its neighbours.
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
    """Return the running median, with ends padded by the end values."""
    sides = _AROUND // 2
    around = sliding_window_view(np.pad(values, sides, mode="edge"), _AROUND)
    return np.sort(around, axis=1)[:, sides]


def _is_spike(departure: Array, at: int) -> bool:
    """Return whether a sample departs from the running median by more than eight times the noise.

    The noise is estimated from the samples near it.
    """
    near = departure[max(0, at - _NEAR) : at + _NEAR + 1]
    noise = _NORMAL * float(np.median(np.abs(near)))
    return bool(abs(departure[at]) > _LEAST_DEPARTURE * noise)
