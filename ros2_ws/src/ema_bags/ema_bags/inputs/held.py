"""Sensor columns that hold their value for several samples: renewed more slowly than published."""

from collections.abc import Mapping as ByName
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

SENSORS: Final = ("position", "speed", "current")

_LEAST_CHANGES: Final = 20
_EARLY: Final = 10.0
_LOOSE_FROM: Final = 5
_REGULAR: Final = 0.9
_USUAL: Final = 0.5
_ONE_COUNT: Final = 1.5
_TOGETHER: Final = 0.9


def held_samples(values: NDArray[np.float64]) -> int:
    """Return for how many samples a column holds each value; 1 if it is renewed each sample.

    An encoder of few counts also repeats its value, but changes by one count and less often the
    slower it moves. A column that is renewed slowly changes at multiples of one time, by any
    amount. 0 if too few changes show which it is.
    """
    finite = values[np.isfinite(values)]
    steps = np.diff(finite)
    rows = np.flatnonzero(steps)
    if len(rows) < _LEAST_CHANGES:
        return 0
    gaps = np.diff(rows)
    held = int(np.percentile(gaps, _EARLY))
    sizes = np.abs(steps[rows])
    if held < 2 or np.mean(sizes < _ONE_COUNT * np.min(sizes)) > _USUAL:
        return 1
    # Publisher and source have clocks of their own: a sample more or less.
    loose = 1 if held >= _LOOSE_FROM else 0
    typical = gaps[np.abs(gaps - np.median(gaps)) <= loose]
    held = round(float(np.mean(typical)))
    off = np.abs(gaps - held * np.maximum(np.rint(gaps / held), 1.0))
    is_held = np.mean(off <= loose) > _REGULAR and len(typical) > _USUAL * len(gaps)
    return held if is_held else 1


def find_held(columns: ByName[str, NDArray[np.float64]]) -> dict[str, int]:
    """Return the samples for which each sensor column holds its values, if more than 1."""
    there = {name: columns[name] for name in SENSORS if len(columns.get(name, ()))}
    by_column = {name: held_samples(values) for name, values in there.items()}
    return {name: held for name, held in by_column.items() if held > 1}


def renewed_rows(columns: ByName[str, NDArray[np.float64]]) -> NDArray[np.int64] | None:
    """Return the rows at which all sensor columns are renewed; None if they have no such rows.

    While nothing changes, rows follow at the time that values are held.
    """
    there = [columns[name] for name in SENSORS if len(columns.get(name, ()))]
    held = find_held(columns)
    if not held or len(held) < len(there) or max(held.values()) > min(held.values()) + 1:
        return None
    period = round(float(np.median(list(held.values()))))
    changes = np.array([np.diff(values, prepend=np.nan) != 0.0 for values in there])
    changed = np.flatnonzero(np.any(changes, axis=0))
    # Columns that are renewed one after the other have no row in common.
    if (
        min(np.mean(np.diff(np.flatnonzero(change)) >= period - 1) for change in changes)
        < _TOGETHER
    ):
        return None
    if np.mean(np.diff(changed) >= period - 1) < _TOGETHER:
        return None
    rows = [changed[:1]]
    for first, last in pairwise(changed.tolist()):
        count = max(1, round((last - first) / period))
        rows.append(first + np.rint(np.arange(1, count + 1) * (last - first) / count))
    return np.concatenate(rows).astype(np.int64)
