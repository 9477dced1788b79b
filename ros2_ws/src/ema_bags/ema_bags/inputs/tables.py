"""CSV and Parquet files as columns of numbers."""

import csv
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ema_bags.inputs.mapping import TIMES_NS, Mapping, Table
from ema_bags.inputs.series import NO_STAMP, Series
from ema_core.wording import unknown_name

PARQUET: Final = (".parquet", ".pq")
"""Ends of the names of Parquet files; any other file is read as CSV."""

_PAUSE_NS: Final = 2_000_000_000
_MOST: Final = 0.9
_SAMPLE_LINES: Final = 400
_SEPARATORS: Final = (";", "\t", ",", "|", " ")
_COMMENT: Final = re.compile(r"^\s*[#%]+\s*")
_UNIT_OF_NAME: Final = re.compile(r"[\[(]\s*([^\[\]()]+?)\s*[\])]\s*$")
_UNIT: Final = re.compile(
    r"^[\[(]?\s*[A-Za-zµ°%][A-Za-zµ°%/.*^²0-9-]{0,9}\s*[\])]?$|^[\[(]?-?[\])]?$"
)


@dataclass(frozen=True)
class TableColumns:
    """Columns of a file.

    Attributes
    ----------
    values
        Columns of numbers by name, ``(n,)`` each; dates are nanoseconds.
    units
        Units by column where the file gives them, as it writes them.
    dates
        Columns that are dates [ns].
    texts
        Columns that hold no numbers, by name.
    format
        How the file is written.
    """

    path: Path
    values: dict[str, NDArray[Any]]
    units: dict[str, str]
    dates: tuple[str, ...]
    texts: dict[str, NDArray[Any]]
    format: Table

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))

    def column(self, name: str) -> NDArray[Any]:
        """Return a column of numbers, or the sum or difference of some: ``"a - b"``.

        Raises
        ------
        ValueError
            When there is none of the name.
        """
        if name in self.values:
            return self.values[name]
        if name in self.texts:
            raise ValueError(f"{self.path}: column {name!r} holds no numbers")
        first, *more = re.split(r"\s([+-])\s", name)
        terms = [(1.0, first.strip())]
        for sign, term in zip(more[::2], more[1::2], strict=True):
            terms.append((1.0 if sign == "+" else -1.0, term.strip()))
        if len(terms) == 1 or not all(term in self.values for _, term in terms):
            raise ValueError(f"{self.path}: {unknown_name('column', name, self.values)}")
        return np.sum([sign * self.values[term].astype(float) for sign, term in terms], axis=0)

    def parts(self, names: Sequence[str]) -> Iterator[tuple[list[str], Self]]:
        """Yield the rows between which none of some columns changes, and these columns' values.

        Raises
        ------
        ValueError
            When there is none of a name.
        """
        for start, end in pairwise(self.bounds(names)):
            values, texts = (
                {name: column[start:end] for name, column in some.items()}
                for some in (self.values, self.texts)
            )
            shown = [str((self.values | self.texts)[name][start]) for name in names]
            yield shown, replace(self, values=values, texts=texts)

    def is_newest_first(self, clock: str) -> bool:
        """Return whether the times of a column go back from row to row."""
        if clock not in self.values:
            return False
        times = self.values[clock]
        steps = np.diff(times[np.isfinite(times)])
        return len(steps) > 0 and float(np.mean(steps < 0)) > _MOST

    def reversed(self) -> Self:
        """Return the table with its last row first."""
        values, texts = (
            {name: column[::-1] for name, column in some.items()}
            for some in (self.values, self.texts)
        )
        return replace(self, values=values, texts=texts)

    def bounds(self, names: Sequence[str]) -> list[int]:
        """Return the rows at which one of some columns changes, with the first and the end.

        Raises
        ------
        ValueError
            When there is none of a name.
        """
        everything = self.values | self.texts
        if unknown := next((name for name in names if name not in everything), None):
            raise ValueError(f"{self.path}: {unknown_name('column', unknown, everything)}")
        given = pd.DataFrame({name: everything[name] for name in names}).astype(str)
        return [*np.flatnonzero((given != given.shift()).any(axis=1)).tolist(), len(given)]


def read_columns(path: Path, table: Table | None = None) -> TableColumns:
    """Read a CSV or Parquet file.

    Parameters
    ----------
    table
        How a CSV file is written; what it leaves open is found out.

    Raises
    ------
    ValueError
        When the file is no table of numbers.
    OSError
        When it cannot be opened.
    """
    if path.suffix.lower() in PARQUET:
        frame, units, written = _read_parquet(path), {}, Table()
    else:
        frame, units, written = _read_csv(path, table or Table())
    values: dict[str, NDArray[Any]] = {}
    dates: list[str] = []
    texts: dict[str, NDArray[Any]] = {}
    for name in frame.columns:
        column = frame[name]
        if (stamps := _dates(column)) is not None:
            dates.append(name)
            values[name] = stamps
        elif pd.api.types.is_timedelta64_dtype(column.dtype):
            values[name] = column.dt.total_seconds().to_numpy(float)
            units[name] = "s"
        elif pd.api.types.is_numeric_dtype(column.dtype):
            # A missing whole number has no place in an array of these.
            missing = {"dtype": float, "na_value": np.nan} if column.hasnans else {}
            values[name] = column.to_numpy(**missing)
        else:
            points = column.astype(str).str.replace(",", ".") if written.decimal == "," else column
            numbers = pd.to_numeric(points, errors="coerce")
            if numbers.notna().mean() > 0.5:
                values[name] = numbers.to_numpy(float)
            else:
                texts[name] = column.to_numpy(object)
        if unit := _UNIT_OF_NAME.search(str(name)):
            units.setdefault(name, unit[1])
    if not values or not len(frame):
        raise ValueError(f"{path} has no columns of numbers: {len(frame)} lines were read")
    return TableColumns(path, values, units, tuple(dates), texts, written)


def table_series(columns: TableColumns, mapping: Mapping) -> Series:
    """Return what a mapping wants of a file; the stamps are of its clock, without it of the rate.

    Raises
    ------
    ValueError
        When a column is not there.
    """
    if columns.is_newest_first(mapping.clock.source):
        columns = columns.reversed()
    values = {key: columns.column(text).astype(float) for key, text, _ in mapping.wanted()}
    clock = mapping.clock
    rows = np.arange(len(columns), dtype=np.int64)
    bounds = columns.bounds([mapping.table.segment]) if mapping.table.segment else []
    if not clock.source:
        stamps = np.rint(rows * (1e9 / clock.rate_hz)).astype(np.int64)
        stamps = _paused(stamps, stamps, bounds)
        return Series(stamps, stamps, values)
    times = columns.column(clock.source)
    unit = 1 if clock.source in columns.dates else TIMES_NS[clock.unit]
    stamps = stamps_of(times, unit)
    known = stamps != NO_STAMP
    if np.count_nonzero(known) < 2:
        raise ValueError(f"{columns.path}: column {clock.source!r} has no two times")
    # Rows take the part of arrival: one sample after the other, at the rate of the stamps around.
    first = stamps[known][0]
    arrivals = first + np.rint(
        np.interp(rows, rows[known], (stamps[known] - first).astype(float))
    ).astype(np.int64)
    stamps = np.where(known, _paused(stamps, arrivals, bounds), NO_STAMP)
    return Series(stamps, _paused(arrivals, arrivals, bounds), values)


def _paused(
    stamps: NDArray[np.int64], arrivals: NDArray[np.int64], bounds: Sequence[int]
) -> NDArray[np.int64]:
    """Return stamps with a pause [ns] before each record of its own, by when rows arrived."""
    shifts = np.zeros(len(stamps), dtype=np.int64)
    for start in bounds[1:-1]:
        shifts[start:] += _PAUSE_NS - min(_PAUSE_NS, arrivals[start] - arrivals[start - 1])
    return stamps + shifts


def stamps_of(times: NDArray[Any], unit_ns: int) -> NDArray[np.int64]:
    """Return times as stamps, ``(n,)`` [ns]; ``NO_STAMP`` where a time is not a number."""
    if np.issubdtype(times.dtype, np.integer):
        return times.astype(np.int64) * unit_ns
    finite = np.isfinite(times)
    whole = np.where(finite, np.floor(times), 0.0)
    # Whole units and their fraction apart: a product would lose the last digits of late times.
    fraction = np.where(finite, times - whole, 0.0)
    stamps = whole.astype(np.int64) * unit_ns + np.rint(fraction * unit_ns).astype(np.int64)
    return np.where(finite, stamps, NO_STAMP)


def _read_parquet(path: Path) -> pd.DataFrame:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        frame = parquet.read_table(path).to_pandas()
    except pa.ArrowInvalid as error:
        raise ValueError(f"{path} is not a Parquet file: {error}") from error
    frame.columns = _flat(frame.columns)
    index = frame.index
    is_time = pd.api.types.is_datetime64_any_dtype(index) or isinstance(index, pd.TimedeltaIndex)
    name = str(index.name or ("time" if is_time else ""))
    if name and name not in frame.columns and not isinstance(index, pd.MultiIndex):
        frame.insert(0, name, index)
    return frame


def _flat(names: "pd.Index[Any]") -> list[str]:
    """Return the names of columns; of several levels of headings those that differ, in one text."""
    if not isinstance(names, pd.MultiIndex):
        return [str(name) for name in names]
    levels = [
        level for level in range(names.nlevels) if len(set(names.get_level_values(level))) > 1
    ]
    parts = [[str(name[level]) for level in levels or [names.nlevels - 1]] for name in names]
    return [
        " ".join(part for part in one if part and not part.startswith("Unnamed")) for one in parts
    ]


def _read_csv(path: Path, table: Table) -> tuple[pd.DataFrame, dict[str, str], Table]:
    encoding, lines = _first_lines(path)
    if not any(line.strip() for line in lines):
        raise ValueError(f"{path} is empty: expected lines of numbers below a line of names")
    separator, decimal = _style(path, lines, table)
    try:
        names, units, first = _head(lines, separator, decimal)
        frame = pd.read_csv(
            path,
            sep=r"\s+" if separator == " " else separator,
            decimal=decimal,
            header=None,
            names=names,
            index_col=False,
            skiprows=first,
            encoding=encoding,
            skipinitialspace=True,
            low_memory=False,
        )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, ValueError) as error:
        raise ValueError(f"{path} is not a table: {error}") from error
    # A separator at the end of each line makes a last column of nothing.
    last = names[-1]
    if last == _unnamed(len(names)) and len(names) > 1 and frame[last].isna().all():
        frame = frame.drop(columns=last)
    return frame, units, Table(separator, decimal)


def _first_lines(path: Path) -> tuple[str, list[str]]:
    """Return the encoding of a file and its first lines."""
    with path.open("rb") as file:
        data = b"".join(file.readline() for _ in range(_SAMPLE_LINES))
    is_wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16" if is_wide else "utf-8-sig", "latin-1"):
        with suppress(UnicodeDecodeError):
            text = data.decode(encoding)
            if "\0" not in text:
                return encoding, text.splitlines()
    raise ValueError(f"{path} is not a text file: expected CSV, Parquet (.parquet) or a bag")


def _style(path: Path, lines: Sequence[str], table: Table) -> tuple[str, str]:
    """Return separator and decimal sign: those that make most of the lines rows of numbers."""
    best, chosen = 0.0, None
    # What stands at the top is a heading, if anything.
    filled = [line for line in lines if line.strip()]
    if len(filled) < 2:
        raise ValueError(f"{path} has no second line: expected a heading and rows of numbers")
    rows = filled[-max(1, len(lines) * 2 // 3) :]
    for separator in (table.separator,) if table.separator else _SEPARATORS:
        for decimal in (table.decimal,) if table.decimal else (".", ","):
            if separator == decimal:
                continue
            cells = [_cells(line, separator) for line in rows]
            widths = [len(row) for row in cells]
            width = max(set(widths), key=widths.count)
            if width < 2:
                continue
            whole = [row for row in cells if len(row) == width]
            numbers = sum(_is_number(cell, decimal) for row in whole for cell in row)
            share = numbers / (width * len(cells))
            if share > best + 1e-9:
                best, chosen = share, (separator, decimal)
    if chosen is None or best < 0.3:
        raise ValueError(
            f"{path} is not a table of numbers: no separator of "
            f"{', '.join(map(repr, _SEPARATORS))} divides its lines into columns of numbers"
        )
    return chosen


def _head(
    lines: Sequence[str], separator: str, decimal: str
) -> tuple[list[str], dict[str, str], int]:
    """Return names and units of the columns and the number of the first line of numbers."""
    rows = [_cells(_COMMENT.sub("", line), separator) for line in lines]
    width = max((len(row) for row in rows[-20:]), default=0)

    def is_data(line: str, row: list[str]) -> bool:
        if len(row) < 2 or _COMMENT.match(line):
            return False
        return sum(_is_number(cell, decimal) for cell in row) >= 0.5 * sum(map(bool, row)) > 0

    first = next((i for i, row in enumerate(rows) if is_data(lines[i], row)), None)
    if first is None:
        raise ValueError(f"none of its first {len(lines)} lines is a row of numbers")
    heads = [i for i in range(first) if len(rows[i]) == width]
    if not heads and not any(row[-1] for row in rows[first:] if len(row) == width):
        # Each row of numbers ends with a separator, and the heading does not.
        heads = [i for i in range(first) if len(rows[i]) == width - 1]
        for i in heads:
            rows[i] = [*rows[i], ""]
    units: list[str] = []
    if len(heads) > 1 and all(_UNIT.match(cell) for cell in rows[heads[-1]]):
        units = [cell.strip("[]() ") for cell in rows[heads.pop()]]
    names = rows[heads[-1]] if heads else [_unnamed(i + 1) for i in range(width)]
    unique: list[str] = []
    for number, name in enumerate(names):
        name = name.strip() or _unnamed(number + 1)
        unique.append(f"{name} ({number + 1})" if name in unique else name)
    given = {n: u for n, u in zip(unique, units, strict=False) if u.strip("-")}
    return unique, given, first


def _unnamed(number: int) -> str:
    return f"column {number}"


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _is_number(cell: str, decimal: str) -> bool:
    if decimal == ",":
        if "." in cell:
            return False
        cell = cell.replace(",", ".")
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _dates(column: "pd.Series[Any]") -> NDArray[np.int64] | None:
    """Return a column of dates, or texts that are dates [ns]; None when it is none."""
    if not pd.api.types.is_datetime64_any_dtype(column.dtype):
        there = column.dropna()
        if not len(there) or not re.match(r"\s*\d{4}-\d\d-\d\d([T ]\d\d:|$)", str(there.iloc[0])):
            return None
        try:
            column = pd.to_datetime(column, utc=True, format="ISO8601", errors="coerce")
        except ValueError:
            return None
    moments = pd.DatetimeIndex(column)
    moments = moments.tz_convert(None) if moments.tz is not None else moments
    return moments.to_numpy().astype("datetime64[ns]").astype(np.int64)
