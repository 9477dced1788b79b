# SPDX-License-Identifier: Apache-2.0
"""Reading of CSV files; ``csv_heading`` reads their heading."""

import re
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.cells import shows_decimals
from ema_bags.inputs.csv_heading import (
    first_lines,
    read_heading,
    separator_and_decimal,
    split_cells,
    unnamed,
)
from ema_bags.inputs.mapping import Table
from ema_bags.inputs.on_demand import pd
from ema_bags.inputs.plain_table import read_plain_csv
from ema_bags.inputs.table_columns import StoredTable

_MORE_CELLS: Final = re.compile(r"Expected (\d+) fields in line (\d+), saw (\d+)")


def read_csv(path: Path, table: Table) -> StoredTable:
    """Read a CSV file.

    Parameters
    ----------
    path
        The file.
    table
        Format of the file; missing entries are detected.

    Raises
    ------
    ValueError
        If the file is not a table of numbers.
    OSError
        If the file cannot be opened.
    """
    encoding, lines = first_lines(path)
    if not any(line.strip() for line in lines):
        raise ValueError(f"{path} is empty: expected a line of names, followed by lines of numbers")
    separator, decimal = separator_and_decimal(path, lines, table)
    written = Table(separator, decimal)
    try:
        names, units, first = read_heading(lines, separator)
        rows = [split_cells(line, separator) for line in lines[first:] if line.strip()]
        plain = None
        if decimal == ".":
            plain = read_plain_csv(path, names, rows, separator, skiprows=first, encoding=encoding)
        if plain is not None and not any(map(_may_have_thousands, plain.values())):
            return StoredTable(plain, units, written)
        # Trailing separators create empty columns.
        extra = [unnamed(i + 1) for i in range(len(names), max(map(len, rows), default=0))]
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
    return StoredTable(dict(frame.drop(columns=extra).items()), units, written)


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
    is_integer = values % 1.0 == 0.0
    return bool(np.any(is_integer) and not np.all(is_integer)) and not shows_decimals(values)
