"""The Parquet files of an archive: one for each model, unit and month, replaced as a whole."""

import hashlib
import shutil
from collections.abc import Collection, Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import pyarrow as pa
import pyarrow.parquet as pq

from ema_archive.tables import PARTITIONED
from ema_core.files import complete_file

TABLES: Final = "tables"
"""Folder of the tables in an archive."""

STAMPS: Final = {"estimates": "end_ns", "usage": "stamp_ns", "duty": "stamp_ns"}
"""Column with the time of a row, for the tables with a file per month."""

_LONGEST: Final = 240
"""Longest name in a path: file systems accept 255 characters including the prefix."""

_FILE: Final = "part.parquet"


def shortened(name: str) -> str:
    """Return a name valid as a folder's: a digest replaces the end of a long name."""
    if len(quoted(name)) <= _LONGEST:
        return name
    digest = hashlib.sha256(name.encode()).hexdigest()[:16]
    kept = name
    while len(quoted(kept)) > _LONGEST - 1 - len(digest):
        kept = kept[:-1]
    return f"{kept}~{digest}"


def quoted(name: str) -> str:
    """Return a name as it is written in a path, from which DuckDB and others read it."""
    return quote(name, safe=" +")


def month_of(stamp_ns: int) -> str:
    """Return the month of a stamp in UTC, as in paths."""
    return datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC).strftime("%Y-%m")


def path_of(archive: Path, table: str, model: str, unit: str, month: str = "") -> Path:
    """Return the file of a unit in a table, or of a month if the table has a file per month."""
    folder = archive / TABLES / table / f"model={quoted(model) or 'unknown'}/unit={quoted(unit)}"
    return (folder / f"month={month}" if month else folder) / _FILE


def replace_rows(
    path: Path, table: str, bags: Collection[str], rows: Iterable[dict[str, Any]]
) -> None:
    """Put rows of some bags in the place of those that they had in a file.

    The file is removed where it would have no rows; where it cannot be written it is as it was.
    """
    new = pa.Table.from_pylist(list(rows), PARTITIONED[table])
    if path.exists():
        old = _read(path, table)
        is_kept = [bag not in bags for bag in old["bag"].to_pylist()]
        new = pa.concat_tables([old.filter(pa.array(is_kept)), new])
    if new.num_rows:
        write_table(path, _in_order(new, table))
    elif path.exists():
        path.unlink()
        path.parent.rmdir()


def read_unit(archive: Path, table: str, unit: str) -> pa.Table:
    """Return all rows of a unit in order of time."""
    month = "*" if table in STAMPS else ""
    pattern = f"model=*/unit={quoted(unit)}/{month}/{_FILE}"
    paths = sorted((archive / TABLES / table).glob(pattern))
    empty = PARTITIONED[table].empty_table()
    return _in_order(pa.concat_tables([empty, *(_read(path, table) for path in paths)]), table)


def write_health(archive: Path, model: str, unit: str, rows: pa.Table) -> Path:
    """Write the rows of health of a unit, in the place of earlier ones; return their file."""
    kept = path_of(archive, "health", model, unit)
    if rows.num_rows:
        write_table(kept, rows)
    for folder in (archive / TABLES / "health").glob(f"model=*/unit={quoted(unit)}"):
        if folder != kept.parent or not rows.num_rows:
            shutil.rmtree(folder)
    return kept


def write_table(path: Path, table: pa.Table) -> None:
    """Write a file under another name, which is renamed when it is whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with complete_file(path) as partial:
        pq.write_table(table, partial, compression="zstd")


def read_rows(path: Path, table: str) -> list[dict[str, Any]]:
    """Return the rows in a file of a table; none where it is missing."""
    return _read(path, table).to_pylist() if path.exists() else []


def _read(path: Path, table: str) -> pa.Table:
    try:
        # Without the columns given by the names of its folders.
        return pq.ParquetFile(path).read().cast(PARTITIONED[table])
    except (pa.ArrowInvalid, ValueError) as error:
        raise ValueError(f"{path} is damaged: {error}") from error


def _in_order(rows: pa.Table, table: str) -> pa.Table:
    names = [STAMPS[table], "bag", "number"] if table in STAMPS else ["stamp_ns"]
    return rows.sort_by([(name, "ascending") for name in names])
