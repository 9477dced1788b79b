"""Order of samples that are displaced by a few places, for example by two threads."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

MOST_DISPLACED: Final = 4
"""Largest displacement of a sample from its place in the order of stamps [samples]."""


def sorting_order(stamps_ns: NDArray[np.int64]) -> NDArray[np.intp] | None:
    """Return the order of samples by their stamps, ``(n,)``; None if nothing is to be sorted.

    Samples are sorted where each is out of order by at most four samples. A clock that goes back
    by more divides the samples.
    """
    steps = np.diff(stamps_ns)
    forward = steps[steps > 0]
    if len(forward) == len(steps) or not len(forward):
        return None
    furthest_ns = (MOST_DISPLACED + 0.5) * float(np.median(forward))
    order = np.arange(len(stamps_ns))
    is_sorted = False
    for part in np.split(order.copy(), np.flatnonzero(np.abs(steps) > furthest_ns) + 1):
        by_stamp = np.argsort(stamps_ns[part], kind="stable")
        displaced = np.abs(by_stamp - np.arange(len(part)))
        if 0 < np.max(displaced, initial=0) <= MOST_DISPLACED:
            order[part] = part[by_stamp]
            is_sorted = True
    return order if is_sorted else None


def settled_samples(stamps_ns: NDArray[np.int64], before_ns: int | None, period_ns: float) -> int:
    """Return how many samples no later sample belongs between or before.

    A sample that is missing among the last four may still come.

    Parameters
    ----------
    stamps_ns
        Stamps in their order, ``(n,)`` [ns].
    before_ns
        Stamp of the sample before; None without one [ns].
    period_ns
        Sample period [ns].
    """
    if not len(stamps_ns):
        return 0
    first = stamps_ns[0] - round(period_ns) if before_ns is None else before_ns
    steps = np.diff(stamps_ns, prepend=np.int64(first)) / period_ns
    is_missing = (steps > 1.5) & (steps < MOST_DISPLACED + 0.5)
    is_missing[: max(len(steps) - MOST_DISPLACED, 0)] = False
    missing = np.flatnonzero(is_missing)
    return int(missing[0]) if len(missing) else len(stamps_ns)
