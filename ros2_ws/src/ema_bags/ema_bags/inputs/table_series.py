# SPDX-License-Identifier: Apache-2.0
"""Series of the mapped columns of a table, with a stamp for each row."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.mapping import ColumnMapping
from ema_bags.inputs.series import NO_STAMP, Series
from ema_bags.inputs.table_columns import TableColumns

_PAUSE_NS: Final = 2_000_000_000
_DAY_NS: Final = 86_400_000_000_000


def table_series(columns: TableColumns, mapping: ColumnMapping) -> Series:
    """Return the mapped series of a table, stamped by its clock column or by a fixed rate.

    Raises
    ------
    ValueError
        If a mapped column does not exist, or the clock has fewer than two times.
    """
    if columns.is_newest_first(mapping.clock):
        columns = columns.reversed()
    values = {key: columns.column(text).astype(float) for key, text, _ in mapping.wanted()}
    clock = mapping.clock
    rows = np.arange(len(columns), dtype=np.int64)
    bounds = columns.bounds([mapping.table.segment]) if mapping.table.segment else []
    if not clock.source:
        stamps = np.rint(rows * (1e9 / clock.rate_hz)).astype(np.int64)
        stamps = _paused(stamps, stamps, bounds)
        return Series(stamps, stamps, values)
    stamps = _without_strays(columns.stamps(clock))
    is_stamped = stamps != NO_STAMP
    if np.count_nonzero(is_stamped) < 2:
        raise ValueError(f"{columns.path}: column {clock.source!r} has fewer than two times")
    # Tables have no arrival times; interpolate them between the stamped rows.
    first = stamps[is_stamped][0]
    arrivals = first + np.rint(
        np.interp(rows, rows[is_stamped], (stamps[is_stamped] - first).astype(float))
    ).astype(np.int64)
    stamps = np.where(is_stamped, _paused(stamps, arrivals, bounds), NO_STAMP)
    return Series(stamps, _paused(arrivals, arrivals, bounds), values)


def _without_strays(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Replace isolated stamps that are more than a day from their neighbours by ``NO_STAMP``.

    They come from a clock read before it was set, or from a damaged row.
    """
    rows = np.flatnonzero(stamps != NO_STAMP)
    if len(rows) < 3:
        return stamps
    times = stamps[rows].astype(float)
    steps = np.abs(np.diff(times))
    before, after = steps[:-1] > _DAY_NS, steps[1:] > _DAY_NS
    strays = np.concatenate([[False], before & after & (np.abs(times[2:] - times[:-2]) < _DAY_NS)])
    ends = steps[0] > _DAY_NS >= steps[1], steps[-1] > _DAY_NS >= steps[-2]
    strays = np.concatenate([[ends[0]], strays[1:], [ends[1]]])
    return np.where(np.isin(np.arange(len(stamps)), rows[strays]), NO_STAMP, stamps)


def _paused(
    stamps: NDArray[np.int64], arrivals: NDArray[np.int64], bounds: Sequence[int]
) -> NDArray[np.int64]:
    """Shift stamps so that a pause of at least 2 s precedes each separate record [ns]."""
    shifts = np.zeros(len(stamps), dtype=np.int64)
    for start in bounds[1:-1]:
        shifts[start:] += _PAUSE_NS - min(_PAUSE_NS, arrivals[start] - arrivals[start - 1])
    return stamps + shifts
