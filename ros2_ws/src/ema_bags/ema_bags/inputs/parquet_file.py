# SPDX-License-Identifier: Apache-2.0
"""Reading of Parquet files."""

from pathlib import Path
from typing import Any

from ema_bags.inputs.array_columns import list_column, split_columns
from ema_bags.inputs.mapping import Table
from ema_bags.inputs.on_demand import pd
from ema_bags.inputs.plain_table import plain_parquet
from ema_bags.inputs.table_columns import StoredTable


def read_parquet(path: Path, table: Table) -> StoredTable:
    """Read a Parquet file; a pandas index becomes a column.

    An unnamed index becomes the column "time" if it contains times, else "index". Unnamed row
    numbers and a multi-level index are dropped. A column of lists with ``k`` elements each becomes
    the columns ``name_0`` to ``name_{k-1}``.

    Parameters
    ----------
    path
        The file.
    table
        Format of a CSV file; unused, but returned with the columns.

    Raises
    ------
    ValueError
        If the file is not a Parquet file.
    OSError
        If the file cannot be opened.
    """
    import pyarrow as pa
    from pyarrow import parquet

    try:
        with path.open("rb") as file:  # pyarrow cannot open names that are not UTF-8
            stored = parquet.ParquetFile(file).read()
    except pa.ArrowInvalid as error:
        raise ValueError(f"{path} is not a Parquet file: {error}") from error
    for name in stored.column_names:
        if (array := list_column(stored[name])) is not None:
            stored = stored.drop_columns([name])
            for part, values in split_columns(name, array).items():
                stored = stored.append_column(part, pa.array(values))
    if (columns := plain_parquet(stored)) is not None:
        return StoredTable(columns, {}, table)
    frame = stored.to_pandas()
    frame.columns = _flat(frame.columns)
    index = frame.index
    is_time = pd.api.types.is_datetime64_any_dtype(index) or isinstance(index, pd.TimedeltaIndex)
    is_row = isinstance(index, pd.RangeIndex)
    name = str(index.name or ("time" if is_time else "" if is_row else "index"))
    if name and name not in frame.columns and not isinstance(index, pd.MultiIndex):
        frame.insert(0, name, index)
    return StoredTable(dict(frame.items()), {}, table)


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
