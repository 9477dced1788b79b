# SPDX-License-Identifier: Apache-2.0
"""Sensor columns that are updated more slowly than they are published."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.columns.errors import HeldColumn
from ema_core.columns.repetition import held_column, held_samples

SENSORS: Final = ("position", "speed", "current")

_TOGETHER: Final = 0.9


def find_held(columns: Mapping[str, NDArray[np.float64]]) -> dict[str, int]:
    """Return the number of samples per update, for sensor columns that repeat their values."""
    present = {name: columns[name] for name in SENSORS if len(columns.get(name, ()))}
    by_column = {name: held_samples(values) for name, values in present.items()}
    return {name: samples for name, samples in by_column.items() if samples > 1}


def held_columns(columns: Mapping[str, NDArray[np.float64]]) -> Iterator[HeldColumn]:
    """Yield the sensor columns that repeat their values, with irregular ones last.

    Only a position shows irregular updates. Speed and current may stay constant during motion.
    """
    irregular: list[HeldColumn] = []
    for name in SENSORS:
        held = held_column(name, columns[name]) if len(columns.get(name, ())) else None
        if held is not None and held.is_regular:
            yield held
        elif held is not None and name == "position":
            irregular.append(held)
    yield from irregular


def renewed_rows(columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.int64] | None:
    """Return the rows at which the sensor columns are updated, if all are updated together.

    Return None if values are not repeated, or columns are updated at different times. While no
    value changes, rows are spaced by the update period.
    """
    present = [columns[name] for name in SENSORS if len(columns.get(name, ()))]
    held = find_held(columns)
    if not held or len(held) < len(present) or max(held.values()) > min(held.values()) + 1:
        return None
    period = round(float(np.median(list(held.values()))))
    changes = np.array([np.diff(values, prepend=np.nan) != 0.0 for values in present])
    changed = np.flatnonzero(np.any(changes, axis=0))
    # Columns that are updated one after another share no row.
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
