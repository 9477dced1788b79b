# SPDX-License-Identifier: Apache-2.0
"""Encoding, separator, decimal sign, column names and units of a CSV file, from its first lines."""

import csv
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from ema_bags.inputs.cells import is_number, may_be_number
from ema_bags.inputs.dates import is_time
from ema_bags.inputs.mapping import Table

_SAMPLE_LINES: Final = 400
_WIDE_BYTES: Final = 1 << 18
_MOST_SHOWN: Final = 60
_SEPARATORS: Final = (";", "\t", ",", "|", " ")
_COMMENT: Final = re.compile(r"^\s*[#%]+\s*")
_UNIT: Final = re.compile(
    r"^[\[(]?\s*[A-Za-zµ°%][A-Za-zµ°%/.*^²0-9-]{0,9}\s*[\])]?$|^[\[(]?-?[\])]?$"
)


def first_lines(path: Path) -> tuple[str, list[str]]:
    """Return the encoding and the first lines of a file; ValueError if it is not a text file."""
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


def separator_and_decimal(path: Path, lines: Sequence[str], table: Table) -> tuple[str, str]:
    """Return the separator and decimal sign for which most cells are numbers.

    Raises
    ------
    ValueError
        If there are fewer than two lines, or no separator makes columns of numbers.
    """
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
            cells = [split_cells(line, separator) for line in rows]
            widths = [len(row) for row in cells]
            width = max(set(widths), key=widths.count)
            if width < 2:
                continue
            complete = [row for row in cells if len(row) == width]
            numbers = sum(_likelihood(cell, decimal) for row in complete for cell in row)
            share = numbers / (width * len(cells))
            if share > best + 1e-9:
                best, chosen = share, (separator, decimal)
    if chosen is None or best < 0.3:
        raise ValueError(
            f"{path} is not a table of numbers: none of the separators "
            f"{', '.join(map(repr, _SEPARATORS))} splits its lines into numeric columns"
        )
    return chosen


def read_heading(lines: Sequence[str], separator: str) -> tuple[list[str], dict[str, str], int]:
    """Return column names, column units and the index of the first data line.

    Raises
    ------
    ValueError
        If no line is a row of numbers.
    """
    rows = [split_cells(_COMMENT.sub("", line), separator) for line in lines]
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
    names = rows[heads[-1]] if heads else [unnamed(i + 1) for i in range(width)]
    unique: list[str] = []
    for number, name in enumerate(names):
        name = name.strip() or unnamed(number + 1)
        unique.append(f"{name} ({number + 1})" if name in unique else name)
    by_name = {n: u for n, u in zip(unique, units, strict=False) if u.strip("-")}
    return unique, by_name, first


def _filled(row: Sequence[str]) -> int:
    """Return the number of cells up to the last non-empty cell."""
    return max((number for number, cell in enumerate(row, 1) if cell), default=0)


def _shortened(line: str) -> str:
    return line if len(line) <= _MOST_SHOWN else f"{line[:_MOST_SHOWN]} ..."


def unnamed(number: int) -> str:
    """Return the name of a column without a heading; columns count from 1."""
    return f"column {number}"


def split_cells(line: str, separator: str) -> list[str]:
    """Return the cells of a line, without surrounding spaces."""
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _likelihood(cell: str, decimal: str) -> float:
    """Return 1 for times and numbers with this decimal sign, 0.5 for other numbers, else 0."""
    if is_number(cell, decimal) or is_time(cell):
        return 1.0
    return 0.5 * may_be_number(cell)
