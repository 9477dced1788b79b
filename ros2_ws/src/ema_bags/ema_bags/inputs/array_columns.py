# SPDX-License-Identifier: Apache-2.0
"""Columns from arrays: NumPy archives, and arrays of equal length in the rows of a table."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.mapping import Table
from ema_bags.inputs.table_columns import StoredTable

_NUMBERS = "biuf"


def read_archive(path: Path, table: Table) -> StoredTable:
    """Read a NumPy archive (``.npz``).

    An array ``(n, k)`` or ``(k, n)`` becomes the columns ``name_0`` to ``name_{k-1}``. Scalars,
    strings and arrays of other lengths are ignored.

    Parameters
    ----------
    path
        The file.
    table
        Format of a CSV file; unused, but returned with the columns.

    Raises
    ------
    ValueError
        If the file is not an archive, or no two arrays have the same length.
    OSError
        If the file cannot be read.
    """
    arrays: dict[str, NDArray[Any]] = {}
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            for name in archive.files:
                try:
                    array = np.asarray(archive[name])
                except ValueError:  # objects, which need pickle
                    continue
                if array.dtype.kind in _NUMBERS and array.ndim in (1, 2) and array.size:
                    arrays[name] = np.squeeze(array)
    except OSError:
        raise
    except Exception as error:  # numpy and zipfile raise many types for damaged archives
        raise ValueError(f"{path} is not a NumPy archive (.npz): {error}") from error
    lengths = Counter(
        max(array.shape) if array.ndim == 2 else len(array)
        for array in arrays.values()
        if array.ndim
    )
    length, count = lengths.most_common(1)[0] if lengths else (0, 0)
    if count < 2:
        listed = ", ".join(f"{name} {array.shape}" for name, array in arrays.items()) or "none"
        raise ValueError(
            f"{path} has no two arrays of the same length: expected one row per sample; arrays: "
            f"{listed}"
        )
    columns: dict[str, NDArray[Any]] = {}
    for name, array in arrays.items():
        if array.ndim == 1 and len(array) == length:
            columns[name] = array
        elif array.ndim == 2 and length in array.shape:
            columns |= split_columns(name, array if len(array) == length else array.T)
    return StoredTable(columns, {}, table)


def split_columns(
    name: str, table: NDArray[Any], parts: Sequence[str] = ()
) -> dict[str, NDArray[Any]]:
    """Return the columns of an array ``(n, k)``, named by their index or by ``parts``."""
    if len(parts) == table.shape[1] and len(set(parts)) == len(parts):
        names = [f"{name}.{part}" for part in parts]
    else:
        names = [f"{name}_{number}" for number in range(table.shape[1])]
    return dict(zip(names, np.ascontiguousarray(table.T), strict=True))


def list_column(column: Any) -> NDArray[Any] | None:
    """Return a column of equally long lists of numbers as an array ``(n, k)``, else None.

    Parameters
    ----------
    column
        A ``pyarrow.ChunkedArray``.
    """
    import pyarrow as pa

    is_list = (
        pa.types.is_list(column.type)
        or pa.types.is_large_list(column.type)
        or pa.types.is_fixed_size_list(column.type)
    )
    value = column.type.value_type if is_list else None
    is_number = value is not None and (pa.types.is_floating(value) or pa.types.is_integer(value))
    if not is_number or not len(column) or column.null_count:
        return None
    flat = np.concatenate([np.asarray(chunk.flatten()) for chunk in column.chunks])
    width = len(column[0])
    lengths = {len(column[0]), len(column[len(column) - 1])}
    if not width or len(lengths) > 1 or len(flat) != width * len(column):
        return None
    return flat.reshape(len(column), width)


def parts_of(names: Any) -> tuple[str, ...]:
    """Return the names of the elements of an array, given as a list or grouped in a mapping.

    Empty if ``names`` is neither.
    """
    if isinstance(names, Mapping):
        names = [name for group in names.values() for name in group]
    if not isinstance(names, list):
        return ()
    return tuple(str(name) for name in names)
