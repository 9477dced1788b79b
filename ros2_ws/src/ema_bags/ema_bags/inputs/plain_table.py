# SPDX-License-Identifier: Apache-2.0
"""Reading of purely numeric tables without pandas, with identical results."""

import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_WHOLE: Final = re.compile(r"\s*[+-]?\d+\s*")
_MOST_DIGITS: Final = 18  # fit in 64 bits


def read_plain_csv(
    path: Path, names: Sequence[str], rows: Sequence[Sequence[str]], separator: str, **options: Any
) -> dict[str, NDArray[Any]] | None:
    """Read a CSV file if all its cells are plain numbers, else return None.

    Parameters
    ----------
    path
        The file.
    names
        Column names.
    rows
        Cells of the first rows; columns that are integers in these rows are read as integers.
    separator
        Cell separator.
    options
        Further arguments of ``numpy.loadtxt``.
    """
    if not rows or any(len(row) != len(names) for row in rows):
        return None
    cells = [cell for row in rows for cell in row]
    if any(len(cell) > _MOST_DIGITS and _WHOLE.fullmatch(cell) for cell in cells):
        return None
    are_whole = [all(map(_WHOLE.fullmatch, column)) for column in zip(*rows, strict=True)]
    kinds = [(f"f{i}", np.int64 if is_whole else float) for i, is_whole in enumerate(are_whole)]
    delimiter = None if separator == " " else separator
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a fraction in a column of integers
            table = np.loadtxt(path, kinds, comments=None, delimiter=delimiter, ndmin=1, **options)
    except (ValueError, OverflowError, Warning):
        return None
    return {
        name: np.ascontiguousarray(table[field])
        for name, (field, _) in zip(names, kinds, strict=True)
    }


def plain_parquet(table: Any) -> dict[str, NDArray[Any]] | None:
    """Return the columns of a numeric ``pyarrow.Table``; None if pandas is needed.

    Missing values, an index and multi-level headings need pandas.
    """
    import pyarrow as pa

    stored = table.schema.pandas_metadata or {}
    indices = stored.get("index_columns", [])
    is_of_rows = all(isinstance(index, dict) and index.get("name") is None for index in indices)
    types = [field.type for field in table.schema]
    are_numbers = all(pa.types.is_integer(kind) or pa.types.is_floating(kind) for kind in types)
    is_whole = not any(column.null_count for column in table.columns)
    has_one_heading = len(stored.get("column_indexes", [])) <= 1
    if not (table.num_rows and is_of_rows and are_numbers and is_whole and has_one_heading):
        return None
    return {
        # pyarrow's own conversion would import pandas.
        name: np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks])
        for name, column in zip(table.column_names, table.columns, strict=True)
    }
