# SPDX-License-Identifier: Apache-2.0
"""Detection of several publishers of a joint from time stamps."""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.input_defect import InputDefect, Publishers
from ema_bags.inputs.rate import resolution_of

_LEAST_STEPS: Final = 200
_ALTERNATING: Final = 0.2
_MOST_TIMES: Final = 4
_COUNTS: Final = 1.5


def two_publishers(stamps_ns: NDArray[np.int64]) -> Iterator[InputDefect]:
    """Yield a defect if the stamps, ``(n,)`` [ns], interleave two or more publishers.

    A second publisher at the same rate, or at a fraction of it, splits steps at regular intervals;
    up to five publishers at the same rate repeat their steps in each period. Undetected, all would
    be read as one series at a higher rate.
    """
    steps = np.diff(stamps_ns).astype(float)
    if len(steps) < _LEAST_STEPS or np.any(steps[:2] <= 0.0):
        return
    count_ns = resolution_of(stamps_ns)
    for times in range(1, _MOST_TIMES + 1):
        pattern = _pattern(steps, times + 1)
        if pattern is None or np.ptp(pattern) <= _COUNTS * count_ns:
            continue
        # Rotate the pattern so that the two parts of the split step come first.
        ahead = [np.roll(pattern, -first) for first in range(times + 1)]
        regular = [np.array([steps[0] + steps[1], *steps[2:]]) for steps in ahead]
        first = int(np.argmin([np.ptp(steps) for steps in regular]))
        period = float(np.mean(regular[first]))
        if np.ptp(regular[first]) > _ALTERNATING * period / 2.0:
            yield _several(pattern)
            return
        low, high = sorted(1e-6 * ahead[first][:2])
        rates_hz = (1e9 / period, 1e9 / (times * period))
        evidence = Publishers(rates_hz, (float(low), float(high)))
        yield InputDefect(DefectKind.TWO_PUBLISHERS, evidence)
        return


def _several(pattern: NDArray[np.float64]) -> InputDefect:
    """Return the defect for publishers at the same rate, from the steps of one period [ns]."""
    rates_hz = (1e9 / float(np.sum(pattern)),) * len(pattern)
    evidence = Publishers(rates_hz, tuple(1e-6 * step for step in pattern.tolist()))
    return InputDefect(DefectKind.TWO_PUBLISHERS, evidence)


def _pattern(steps: NDArray[np.float64], length: int) -> NDArray[np.float64] | None:
    """Return the pattern of steps if they repeat after exactly `length` steps, else None."""
    periods = steps[: len(steps) // length * length].reshape(-1, length)
    usual = float(np.median(periods.mean(axis=1)))
    # Compare nearby steps only, because clock drift changes the pattern slowly.
    next_changes, period_changes = (np.abs(steps[k:] - steps[:-k]) / usual for k in (1, length))
    is_pattern = np.percentile(period_changes, 90.0) <= _ALTERNATING / 2.0
    if not is_pattern or np.percentile(next_changes, 100.0 - 50.0 / length) < _ALTERNATING:
        return None
    pattern: NDArray[np.float64] = np.median(periods, axis=0)
    return pattern
