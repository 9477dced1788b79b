# SPDX-License-Identifier: Apache-2.0
"""Reading of table files: each column as numbers, times or texts."""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

import numpy as np

from ema_bags.inputs.array_columns import read_archive
from ema_bags.inputs.cells import read_numbers, shows_decimals
from ema_bags.inputs.csv_file import read_csv
from ema_bags.inputs.dates import WrittenTimes, read_times
from ema_bags.inputs.lerobot import EPISODE, is_data_set, read_data_set
from ema_bags.inputs.mapping import Table
from ema_bags.inputs.on_demand import pd
from ema_bags.inputs.parquet_file import read_parquet
from ema_bags.inputs.table_columns import StoredTable, TableColumns
from ema_bags.suffixes import ARCHIVES, PARQUET
from ema_core.files import require_regular_file

READERS: Final[Mapping[str, Callable[[Path, Table], StoredTable]]] = MappingProxyType(
    {**dict.fromkeys(PARQUET, read_parquet), **dict.fromkeys(ARCHIVES, read_archive)}
)
"""Reader of a table file by its suffix; any other file is read as CSV."""

_UNIT_OF_NAME: Final = re.compile(r"[\[(]\s*([^\[\]()]+?)\s*[\])]\s*$")


def read_columns(path: Path, table: Table | None = None) -> TableColumns:
    """Read a CSV, Parquet or ``.npz`` file, or the folder of a LeRobot data set.

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
    if is_data_set(path):
        return TableColumns(path, read_data_set(path), {}, (), {}, Table(segment=EPISODE))
    require_regular_file(path)
    read_file = READERS.get(path.suffix.lower(), read_csv)
    read, units, written = read_file(path, table or Table())
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
    """Return the table with a column of times added.

    The dictionaries of ``columns`` are changed, too: the returned table shares them.
    """
    columns.values[name] = times.values
    if times.problem:
        columns.problems[name] = times.problem
    if times.exchanged is not None:
        columns.exchanged[name] = times.exchanged
        columns.notes[name] = f"the order of day and month is ambiguous: {times.example}"
    of_day = (*columns.of_day, *[name] * times.is_of_day)
    return replace(columns, dates=(*columns.dates, name), of_day=of_day)
