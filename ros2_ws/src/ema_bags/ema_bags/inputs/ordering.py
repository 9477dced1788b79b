# SPDX-License-Identifier: Apache-2.0
"""Sorting of samples that arrive slightly out of order, for example from two threads."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

MOST_DISPLACED: Final = 4
"""Largest displacement that is corrected [samples]."""


def sorting_order(stamps_ns: NDArray[np.int64]) -> NDArray[np.intp] | None:
    """Return the indices that sort samples by stamp, ``(n,)``; None if no sorting is needed.

    Only samples displaced by at most four places are sorted. Larger backward clock steps split the
    samples into parts that are sorted separately.
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
    """Return the number of leading samples whose order is final.

    A sample missing among the last four may still arrive.

    Parameters
    ----------
    stamps_ns
        Sorted stamps, ``(n,)`` [ns].
    before_ns
        Stamp of the preceding sample [ns]; None if there is none.
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
