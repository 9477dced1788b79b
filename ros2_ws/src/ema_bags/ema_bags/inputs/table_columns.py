# SPDX-License-Identifier: Apache-2.0
"""Columns of a table file: as stored, and as numbers, dates and texts."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.dates import ORDERS
from ema_bags.inputs.mapping import EPOCHS, TIMES_NS, Clock, Table
from ema_bags.inputs.on_demand import pd
from ema_bags.inputs.series import NO_STAMP
from ema_core.wording import unknown_name

_DAY_NS: Final = 86_400_000_000_000
_SUM: Final = r"\s([+-])\s"
_MOST: Final = 0.9


class StoredTable(NamedTuple):
    """Columns of a table file as its format stores them."""

    columns: Mapping[str, "pd.Series[Any] | NDArray[Any]"]
    """Columns by name: numeric arrays, or pandas series of any type."""

    units: dict[str, str]
    """Unit by column name, as written in the file."""

    format: Table
    """Separator and decimal sign of a CSV file."""


@dataclass(frozen=True)
class TableColumns:
    """Columns of a table file."""

    path: Path
    """Path of the file."""

    values: dict[str, NDArray[Any]]
    """Numeric columns by name, ``(n,)`` each; dates are in nanoseconds."""

    units: dict[str, str]
    """Unit by column name, as written in the file."""

    dates: tuple[str, ...]
    """Names of the columns with dates or times of day."""

    texts: dict[str, NDArray[Any]]
    """Non-numeric columns by name."""

    format: Table
    """Format of the file."""

    of_day: tuple[str, ...] = ()
    """Names of the columns with times of day but no date."""

    exchanged: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    """Dates with day and month swapped [ns], for columns with an ambiguous order."""

    problems: dict[str, str] = field(default_factory=dict)
    """Reason why a column cannot be used, with row and cell, by column name."""

    notes: dict[str, str] = field(default_factory=dict)
    """How ambiguous cells were interpreted, by column name."""

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    def column(self, name: str) -> NDArray[Any]:
        """Return a numeric column, or a sum or difference of columns such as ``"a - b"``.

        Raises
        ------
        ValueError
            If a column does not exist or cannot be used.
        """
        terms = self._terms(name)
        if len(terms) == 1:
            return self.values[terms[0][1]]
        return np.sum([sign * self.values[term].astype(float) for sign, term in terms], axis=0)

    def notes_of(self, names: Iterable[str]) -> list[str]:
        """Return the notes on ambiguous columns among the given columns or sums."""
        terms = [term for name in names if name for _, term in self._terms(name)]
        return [f"column {name!r}, {self.notes[name]}" for name in terms if name in self.notes]

    def stamps(self, clock: Clock) -> NDArray[np.int64]:
        """Return the times in a column, or in a sum of dates, times of day and numbers [ns].

        Cells without a time give ``NO_STAMP``. Times of day keep increasing past midnight.

        Raises
        ------
        ValueError
            If the column does not exist, its unit does not fit, or the order of day and month is
            ambiguous.
        """
        terms = self._terms(clock.source)
        is_date = {name: name in self.dates for _, name in terms}
        if not any(is_date.values()):
            if clock.unit in ORDERS:
                formats = ", ".join(TIMES_NS)
                raise ValueError(
                    f"{self.path}: column {clock.source!r} contains numbers, not dates: expected "
                    f"clock.unit {formats}"
                )
            return stamps_of(
                self.column(clock.source), TIMES_NS[clock.unit], EPOCHS.get(clock.unit, 0)
            )
        total = np.zeros(len(self), dtype=np.int64)
        is_read = np.ones(len(self), dtype=bool)
        for sign, name in terms:
            stamps = self._moments(name, clock.unit)
            is_read &= stamps != NO_STAMP
            total += sign * np.where(is_read, stamps, 0)
        if all(name in self.of_day for name in is_date):
            rows = np.flatnonzero(is_read)
            midnights = np.diff(total[rows], prepend=total[rows][:1]) < -_DAY_NS // 2
            total[rows] += _DAY_NS * np.cumsum(midnights)
        return np.where(is_read, total, NO_STAMP)

    def _moments(self, name: str, unit: str) -> NDArray[np.int64]:
        """Return the times in one term of a sum with dates [ns]."""
        if name not in self.dates:
            return stamps_of(self.values[name], TIMES_NS.get(unit, 1))
        if name in self.exchanged:
            if unit not in ORDERS:
                raise ValueError(
                    f"{self.path}: column {name!r}, {self.notes[name]}: expected clock.unit "
                    f"{' or '.join(ORDERS)} in the mapping"
                )
            return self.exchanged[name] if unit == ORDERS[1] else self.values[name]
        return self.values[name]

    def _terms(self, text: str) -> list[tuple[int, str]]:
        """Split a sum into the sign and name of each column.

        Raises
        ------
        ValueError
            If a column does not exist or cannot be used.
        """
        first, *more = [text] if text in self.values | self.texts else re.split(_SUM, text)
        terms = [(1, first.strip())]
        for sign, term in zip(more[::2], more[1::2], strict=True):
            terms.append((1 if sign == "+" else -1, term.strip()))
        for _, name in terms:
            if name in self.problems:
                raise ValueError(f"{self.path}: column {name!r}, {self.problems[name]}")
            if name in self.texts:
                raise ValueError(
                    f"{self.path}: column {name!r} contains no numbers{self._cell(name)}"
                )
            if name not in self.values:
                raise ValueError(f"{self.path}: {unknown_name('column', text, self.values)}")
        return terms

    def _cell(self, name: str) -> str:
        """Return row and content of the first non-empty cell of a text column, for messages."""
        filled = np.flatnonzero(~pd.isna(self.texts[name]))
        return f": row {filled[0] + 1}: {self.texts[name][filled[0]]!r}" if len(filled) else ""

    def parts(self, names: Sequence[str]) -> Iterator[tuple[list[str], Self]]:
        """Yield the values of the given columns, and the rows, of each part with constant values.

        Raises
        ------
        ValueError
            If a column does not exist.
        """
        for start, end in pairwise(self.bounds(names)):
            shown = [str((self.values | self.texts)[name][start]) for name in names]
            yield shown, self._rows(slice(start, end))

    def is_newest_first(self, clock: Clock) -> bool:
        """Return whether the clock decreases from row to row."""
        if not clock.source:
            return False
        stamps = self.stamps(clock)
        steps = np.diff(stamps[stamps != NO_STAMP])
        return len(steps) > 0 and float(np.mean(steps < 0)) > _MOST

    def reversed(self) -> Self:
        """Return the table with its rows in reverse order."""
        return self._rows(slice(None, None, -1))

    def _rows(self, rows: slice) -> Self:
        values, texts, exchanged = (
            {name: column[rows] for name, column in columns.items()}
            for columns in (self.values, self.texts, self.exchanged)
        )
        return replace(self, values=values, texts=texts, exchanged=exchanged)

    def bounds(self, names: Sequence[str]) -> list[int]:
        """Return the row numbers at which any of the columns changes, including 0 and the end.

        Raises
        ------
        ValueError
            If a column does not exist.
        """
        columns = self.values | self.texts
        if unknown := next((name for name in names if name not in columns), None):
            raise ValueError(f"{self.path}: {unknown_name('column', unknown, columns)}")
        cells = pd.DataFrame({name: columns[name] for name in names}).astype(str)
        return [*np.flatnonzero((cells != cells.shift()).any(axis=1)).tolist(), len(cells)]


def stamps_of(times: NDArray[Any], unit_ns: int, epoch: int = 0) -> NDArray[np.int64]:
    """Convert times to stamps, ``(n,)`` [ns]; NaN becomes ``NO_STAMP``.

    Parameters
    ----------
    times
        Times in any unit, ``(n,)``.
    unit_ns
        Duration of one unit of ``times`` [ns].
    epoch
        Start of 1970 in the unit of ``times``.
    """
    if np.issubdtype(times.dtype, np.integer):
        return (times.astype(np.int64) - epoch) * unit_ns
    finite = np.isfinite(times)
    integers = np.where(finite, np.floor(times), 0.0)
    # Convert integer part and fraction separately to keep full precision.
    fraction = np.where(finite, times - integers, 0.0)
    stamps = (integers.astype(np.int64) - epoch) * unit_ns + np.rint(fraction * unit_ns).astype(
        np.int64
    )
    return np.where(finite, stamps, NO_STAMP)
