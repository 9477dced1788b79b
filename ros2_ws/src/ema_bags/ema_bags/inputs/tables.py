"""Reading of CSV and Parquet files."""

import csv
import re
from collections.abc import Iterable, Iterator, Sequence
from collections.abc import Mapping as ByName
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.cells import is_number, may_be_number, read_numbers, shows_decimals
from ema_bags.inputs.dates import ORDERS, WrittenTimes, is_time, read_times
from ema_bags.inputs.mapping import EPOCHS, TIMES_NS, Clock, Mapping, Table
from ema_bags.inputs.on_demand import pd
from ema_bags.inputs.plain_table import plain_parquet, read_plain_csv
from ema_bags.inputs.series import NO_STAMP, Series
from ema_bags.suffixes import PARQUET
from ema_core.files import require_regular_file
from ema_core.wording import unknown_name

_PAUSE_NS: Final = 2_000_000_000
_DAY_NS: Final = 86_400_000_000_000
_SUM: Final = r"\s([+-])\s"
_MOST: Final = 0.9
_SAMPLE_LINES: Final = 400
_WIDE_BYTES: Final = 1 << 18
_MOST_SHOWN: Final = 60
_SEPARATORS: Final = (";", "\t", ",", "|", " ")
_MORE_CELLS: Final = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")
_COMMENT: Final = re.compile(r"^\s*[#%]+\s*")
_UNIT_OF_NAME: Final = re.compile(r"[\[(]\s*([^\[\]()]+?)\s*[\])]\s*$")
_UNIT: Final = re.compile(
    r"^[\[(]?\s*[A-Za-zµ°%][A-Za-zµ°%/.*^²0-9-]{0,9}\s*[\])]?$|^[\[(]?-?[\])]?$"
)


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
        """Split the table where the given columns change; yield their values and the rows.

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
            {name: column[rows] for name, column in some.items()}
            for some in (self.values, self.texts, self.exchanged)
        )
        return replace(self, values=values, texts=texts, exchanged=exchanged)

    def bounds(self, names: Sequence[str]) -> list[int]:
        """Return the row numbers at which any of the columns changes, including 0 and the end.

        Raises
        ------
        ValueError
            If a column does not exist.
        """
        everything = self.values | self.texts
        if unknown := next((name for name in names if name not in everything), None):
            raise ValueError(f"{self.path}: {unknown_name('column', unknown, everything)}")
        cells = pd.DataFrame({name: everything[name] for name in names}).astype(str)
        return [*np.flatnonzero((cells != cells.shift()).any(axis=1)).tolist(), len(cells)]


_Columns = ByName[str, "pd.Series[Any] | NDArray[Any]"]
"""Columns by name: numeric arrays or pandas series."""


def read_columns(path: Path, table: Table | None = None) -> TableColumns:
    """Read a CSV or Parquet file.

    Parameters
    ----------
    table
        Format of a CSV file; missing entries are detected.

    Raises
    ------
    ValueError
        If the file is not a table of numbers.
    OSError
        If the file cannot be opened.
    """
    require_regular_file(path)
    if path.suffix.lower() in PARQUET:
        read, units, written = _read_parquet(path), {}, Table()
    else:
        read, units, written = _read_csv(path, table or Table())
    columns = TableColumns(path, {}, units, (), {}, written)
    thousands: dict[str, tuple[str, str]] = {}
    decimals: set[str] = set()
    unclear: dict[str, str] = {}
    for name, column in read.items():
        if isinstance(column, np.ndarray):
            columns.values[name] = column
            if shows_decimals(column):
                decimals.add(written.decimal or ".")
        elif (times := read_times(column)) is not None:
            columns = _with_times(columns, name, times)
        elif pd.api.types.is_timedelta64_dtype(column.dtype):
            columns.values[name] = column.dt.total_seconds().to_numpy(float)
            units[name] = "s"
        elif pd.api.types.is_numeric_dtype(column.dtype):
            # Integer arrays cannot represent missing values.
            missing = {"dtype": float, "na_value": np.nan} if column.hasnans else {}
            columns.values[name] = column.to_numpy(**missing)
            if shows_decimals(columns.values[name]):
                decimals.add(written.decimal or ".")
        elif (numbers := read_numbers(column, written.decimal or ".")) is not None:
            columns.values[name] = numbers.values
            decimals |= {numbers.decimal} - {""}
            if numbers.problem:
                columns.problems[name] = numbers.problem
            if numbers.thousands:
                thousands[name] = numbers.thousands, numbers.example
            if numbers.unclear:
                unclear[name] = numbers.unclear
        else:
            columns.texts[name] = column.to_numpy(object)
        if unit := _UNIT_OF_NAME.search(str(name)):
            units.setdefault(name, unit[1])
    for name, (mark, example) in thousands.items():
        if mark in decimals:
            columns.problems.setdefault(
                name, f"{example}: {mark!r} is the decimal sign in other columns"
            )
        columns.notes[name] = f"{example} is read with {mark!r} as thousands separator"
    if not decimals and not (table and table.decimal):
        for name, example in unclear.items():
            columns.problems[name] = (
                f"{example} may contain a thousands separator or a decimal sign: set table: "
                f"{{decimal: '.'}} or {{decimal: ','}} in the mapping"
            )
    lines = len(next(iter(read.values()), ()))
    if not columns.values or not lines:
        raise ValueError(f"{path} has no numeric columns: {lines} lines were read")
    return columns


def _with_times(columns: TableColumns, name: str, times: WrittenTimes) -> TableColumns:
    """Return the table with a column of times added."""
    columns.values[name] = times.values
    if times.problem:
        columns.problems[name] = times.problem
    if times.exchanged is not None:
        columns.exchanged[name] = times.exchanged
        columns.notes[name] = f"the order of day and month is ambiguous: {times.example}"
    of_day = (*columns.of_day, *[name] * times.is_of_day)
    return replace(columns, dates=(*columns.dates, name), of_day=of_day)


def table_series(columns: TableColumns, mapping: Mapping) -> Series:
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
    whole = np.where(finite, np.floor(times), 0.0)
    # Convert integer part and fraction separately to keep full precision.
    fraction = np.where(finite, times - whole, 0.0)
    stamps = (whole.astype(np.int64) - epoch) * unit_ns + np.rint(fraction * unit_ns).astype(
        np.int64
    )
    return np.where(finite, stamps, NO_STAMP)


def _read_parquet(path: Path) -> _Columns:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        with path.open("rb") as file:  # pyarrow cannot open names that are not UTF-8
            stored = parquet.ParquetFile(file).read()
    except pa.ArrowInvalid as error:
        raise ValueError(f"{path} is not a Parquet file: {error}") from error
    if (columns := plain_parquet(stored)) is not None:
        return columns
    frame = stored.to_pandas()
    frame.columns = _flat(frame.columns)
    index = frame.index
    is_time = pd.api.types.is_datetime64_any_dtype(index) or isinstance(index, pd.TimedeltaIndex)
    is_row = isinstance(index, pd.RangeIndex)
    name = str(index.name or ("time" if is_time else "" if is_row else "index"))
    if name and name not in frame.columns and not isinstance(index, pd.MultiIndex):
        frame.insert(0, name, index)
    return dict(frame.items())


def _flat(names: "pd.Index[Any]") -> list[str]:
    """Return flat column names: join heading levels, omitting constant levels."""
    if not isinstance(names, pd.MultiIndex):
        return [str(name) for name in names]
    levels = [
        level for level in range(names.nlevels) if len(set(names.get_level_values(level))) > 1
    ]
    parts = [[str(name[level]) for level in levels or [names.nlevels - 1]] for name in names]
    return [
        " ".join(part for part in levels if part and not part.startswith("Unnamed"))
        for levels in parts
    ]


def _read_csv(path: Path, table: Table) -> tuple[_Columns, dict[str, str], Table]:
    encoding, lines = _first_lines(path)
    if not any(line.strip() for line in lines):
        raise ValueError(f"{path} is empty: expected a line of names, followed by lines of numbers")
    separator, decimal = _style(path, lines, table)
    written = Table(separator, decimal)
    try:
        names, units, first = _head(lines, separator)
        rows = [_cells(line, separator) for line in lines[first:] if line.strip()]
        plain = None
        if decimal == ".":
            plain = read_plain_csv(path, names, rows, separator, skiprows=first, encoding=encoding)
        if plain is not None and not any(map(_may_have_thousands, plain.values())):
            return plain, units, written
        # Trailing separators create empty columns.
        extra = [_unnamed(i + 1) for i in range(len(names), max(map(len, rows), default=0))]
        options: dict[str, Any] = {
            "sep": r"\s+" if separator == " " else separator,
            "header": None,
            "names": [*names, *extra],
            "index_col": False,
            "skiprows": first,
            "encoding": encoding,
            "skipinitialspace": True,
            "low_memory": False,
        }
        frame = pd.read_csv(path, decimal=decimal, **options)
        if doubtful := [name for name in names if _may_have_thousands(frame[name])]:
            cells = pd.read_csv(path, dtype=str, usecols=doubtful, **options)
            frame = frame.assign(**{name: cells[name] for name in doubtful})
    except (pd.errors.ParserError, pd.errors.EmptyDataError, ValueError) as error:
        if match := _MORE_CELLS.search(str(error)):
            expected, line, cells = map(int, match.groups())
            raise _too_many(path, expected, line, cells) from error
        raise ValueError(f"{path} is not a table: {error}") from error
    for name in extra:
        filled = np.flatnonzero(frame[name].notna())
        if len(filled):
            raise _too_many(path, len(names), first + int(filled[0]) + 1, len(names) + 1)
    return dict(frame.drop(columns=extra).items()), units, written


def _too_many(path: Path, expected: int, line: int, cells: int) -> ValueError:
    return ValueError(
        f"{path}: line {line} has {cells} cells, expected {expected} as in the lines before: "
        "remove the extra separator, or quote the cell that contains it"
    )


def _may_have_thousands(column: "pd.Series[Any] | NDArray[Any]") -> bool:
    """Return whether a thousands separator is possible: 1.885 next to 885 may mean 1885."""
    if getattr(column.dtype, "kind", "") != "f":
        return False
    values = np.asarray(column, dtype=float)
    values = values[np.isfinite(values)]
    whole = values % 1.0 == 0.0
    return bool(np.any(whole) and not np.all(whole)) and not shows_decimals(values)


def _first_lines(path: Path) -> tuple[str, list[str]]:
    """Return the encoding and the first lines of a file."""
    with path.open("rb") as file:
        data = b"".join(file.readline() for _ in range(_SAMPLE_LINES))
        if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            # readline would split UTF-16 characters.
            file.seek(0)
            text = file.read(_WIDE_BYTES).decode("utf-16", errors="ignore")
            return "utf-16", text.splitlines()[:-1][:_SAMPLE_LINES] or text.splitlines()
    for encoding in ("utf-8-sig", "latin-1"):
        with suppress(UnicodeDecodeError):
            text = data.decode(encoding)
            if "\0" not in text:
                return encoding, text.splitlines()
    raise ValueError(f"{path} is not a text file: expected CSV, Parquet (.parquet) or a bag")


def _style(path: Path, lines: Sequence[str], table: Table) -> tuple[str, str]:
    """Return the separator and decimal sign for which most cells are numbers."""
    best, chosen = 0.0, None
    # Skip the top third, which may contain headings.
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
            numbers = sum(_likelihood(cell, decimal) for row in whole for cell in row)
            share = numbers / (width * len(cells))
            if share > best + 1e-9:
                best, chosen = share, (separator, decimal)
    if chosen is None or best < 0.3:
        raise ValueError(
            f"{path} is not a table of numbers: none of the separators "
            f"{', '.join(map(repr, _SEPARATORS))} splits its lines into numeric columns"
        )
    return chosen


def _head(lines: Sequence[str], separator: str) -> tuple[list[str], dict[str, str], int]:
    """Return column names, column units and the index of the first data line."""
    rows = [_cells(_COMMENT.sub("", line), separator) for line in lines]
    # Trailing separators form a column only if another line has a cell there.
    filled = [_filled(row) for row in rows]
    width = max(filled[-20:], default=0)

    def is_data(number: int) -> bool:
        row = rows[number][:width]
        if filled[number] < 2 or len(rows[number]) < width or _COMMENT.match(lines[number]):
            return False
        numbers, times = sum(map(may_be_number, row)), sum(map(is_time, row))
        return numbers > 0 and numbers + times >= 0.5 * sum(map(bool, row))

    first = next(filter(is_data, range(len(rows))), None)
    if first is None:
        shown = next(line for line in reversed(lines) if line.strip()).strip()
        raise ValueError(
            f"none of the first {len(lines)} lines is a row of numbers: expected cells such as "
            f"1.5, 1,5 or -2e3 between separators, found {_shortened(shown)!r}"
        )
    heads = [i for i in range(first) if len(rows[i]) >= width and filled[i] > 1]
    if heads:
        # A column with a heading may be empty in the first rows.
        width = max(width, filled[heads[-1]])
        heads = [i for i in heads if len(rows[i]) >= width]
    rows = [row[:width] for row in rows]
    units: list[str] = []
    # A row of units must follow a row that names all columns.
    is_below = len(heads) > 1 and filled[heads[-2]] == width
    if is_below and all(_UNIT.match(cell) for cell in rows[heads[-1]]):
        units = [cell.strip("[]() ") for cell in rows[heads.pop()]]
    names = rows[heads[-1]] if heads else [_unnamed(i + 1) for i in range(width)]
    unique: list[str] = []
    for number, name in enumerate(names):
        name = name.strip() or _unnamed(number + 1)
        unique.append(f"{name} ({number + 1})" if name in unique else name)
    by_name = {n: u for n, u in zip(unique, units, strict=False) if u.strip("-")}
    return unique, by_name, first


def _filled(row: Sequence[str]) -> int:
    """Return the number of cells up to the last non-empty cell."""
    return max((number for number, cell in enumerate(row, 1) if cell), default=0)


def _shortened(line: str) -> str:
    return line if len(line) <= _MOST_SHOWN else f"{line[:_MOST_SHOWN]} ..."


def _unnamed(number: int) -> str:
    return f"column {number}"


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _likelihood(cell: str, decimal: str) -> float:
    """Return 1 for times and numbers with this decimal sign, 0.5 for other numbers, else 0."""
    if is_number(cell, decimal) or is_time(cell):
        return 1.0
    return 0.5 * may_be_number(cell)
