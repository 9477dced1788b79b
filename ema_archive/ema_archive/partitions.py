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

from ema_archive.tables import ESTIMATES, GROWTH, HEALTH, USAGE
from ema_core.files import complete_file

TABLES: Final = "tables"
"""Folder of the tables in an archive."""

SCHEMAS: Final = {"estimates": ESTIMATES, "usage": USAGE, "health": HEALTH, "growth": GROWTH}
"""Columns of the tables by name."""

_LONGEST: Final = 240
"""Characters of a name in a path, of the 255 that file systems take, with what stands before it."""

_FILE: Final = "part.parquet"
_UNNAMED: Final = "unknown"
_ORDER: Final = {
    "estimates": [("end_ns", "ascending"), ("bag", "ascending"), ("number", "ascending")],
    "health": [("stamp_ns", "ascending")],
    "usage": [("stamp_ns", "ascending"), ("bag", "ascending"), ("number", "ascending")],
}


def shortened(name: str) -> str:
    """Return a name that may be that of a folder: a digest stands for the end of a long one."""
    if len(quoted(name)) <= _LONGEST:
        return name
    digest = hashlib.sha256(name.encode()).hexdigest()[:16]
    kept = name
    while len(quoted(kept)) > _LONGEST - 1 - len(digest):
        kept = kept[:-1]
    return f"{kept}~{digest}"


def month_of(stamp_ns: int) -> str:
    """Return the month of a stamp in UTC, as in paths."""
    return datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC).strftime("%Y-%m")


def replace_rows(
    archive: Path,
    table: str,
    place: tuple[str, str, str],
    bags: Collection[str],
    rows: Iterable[dict[str, Any]],
) -> Path:
    """Put rows of some bags in the place of those that they had in a month of a unit.

    Parameters
    ----------
    place
        Model, unit and month.
    bags
        Addresses of the bags, those without new rows included.
    rows
        Their rows.

    Returns
    -------
    Path
        The file; it is not there where it would have no rows.

    Raises
    ------
    OSError
        When it cannot be written; the file is as it was.
    """
    model, unit, month = place
    folder = _unit_folder(archive, table, model, unit) / f"month={month}"
    path, schema = folder / _FILE, SCHEMAS[table]
    new = pa.Table.from_pylist(list(rows), schema)
    if path.exists():
        old = _read(path, schema)
        is_kept = [bag not in bags for bag in old["bag"].to_pylist()]
        new = pa.concat_tables([old.filter(pa.array(is_kept)), new])
    if new.num_rows:
        _write(path, new.sort_by(_ORDER[table]))
    elif path.exists():
        path.unlink()
        folder.rmdir()
    return path


def read_unit(archive: Path, table: str, unit: str) -> pa.Table:
    """Return all rows of a unit in order of time."""
    schema = SCHEMAS[table]
    folders = (archive / TABLES / table).glob(f"model=*/unit={quoted(unit)}")
    parts = [
        _read(path, schema)
        for folder in sorted(folders)
        for path in sorted([*folder.glob(f"*/{_FILE}"), *folder.glob(_FILE)])
    ]
    whole = pa.concat_tables(parts) if parts else schema.empty_table()
    return whole.sort_by(_ORDER[table])


def write_health(archive: Path, model: str, unit: str, rows: pa.Table) -> Path:
    """Write the rows of health of a unit, in the place of earlier ones; return their file."""
    kept = _unit_folder(archive, "health", model, unit)
    if rows.num_rows:
        _write(kept / _FILE, rows)
    for folder in (archive / TABLES / "health").glob(f"model=*/unit={quoted(unit)}"):
        if folder != kept or not rows.num_rows:
            shutil.rmtree(folder)
    return kept / _FILE


def place_of(path: Path) -> tuple[str, str, str]:
    """Return table, unit and month of a file of a table, as in paths; the month may be empty."""
    keys = dict(part.split("=", 1) for part in path.parts if "=" in part)
    table = path.parts[path.parts.index(TABLES) + 1]
    return table, keys["unit"], keys.get("month", "")


def read_state(archive: Path, unit: str) -> bytes:
    """Return what was kept of a unit by `write_state`; empty when nothing."""
    try:
        return _state_path(archive, unit).read_bytes()
    except FileNotFoundError:
        return b""


def write_state(archive: Path, unit: str, state: bytes) -> None:
    """Keep what is known of a unit, for later tests to go on from."""
    path = _state_path(archive, unit)
    path.parent.mkdir(exist_ok=True)
    with complete_file(path) as partial:
        partial.write_bytes(state)


def _state_path(archive: Path, unit: str) -> Path:
    return archive / "state" / f"{quoted(unit)}.bin"


def write_whole(archive: Path, name: str, table: pa.Table) -> None:
    """Write a table that is one file."""
    _write(archive / TABLES / f"{name}.parquet", table)


def _unit_folder(archive: Path, table: str, model: str, unit: str) -> Path:
    return archive / TABLES / table / f"model={quoted(model) or _UNNAMED}" / f"unit={quoted(unit)}"


def quoted(name: str) -> str:
    """Return a name as it is written in a path, from which DuckDB and others read it."""
    return quote(name, safe=" +")


def _read(path: Path, schema: pa.Schema) -> pa.Table:
    try:
        # Without what the names of its folders say.
        return pq.ParquetFile(path).read().cast(schema)
    except (pa.ArrowInvalid, ValueError) as error:
        raise ValueError(f"{path} is damaged: {error}") from error


def _write(path: Path, table: pa.Table) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with complete_file(path) as partial:
        pq.write_table(table, partial, compression="zstd")
