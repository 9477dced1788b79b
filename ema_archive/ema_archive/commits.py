# SPDX-License-Identifier: Apache-2.0
"""Writing of bag and unit results to the store, one transaction per batch."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

import duckdb
import pyarrow as pa

from ema_archive.bag_task import DAMAGED, FAILED, BagResult
from ema_archive.history_rows import HISTORY_TABLES
from ema_archive.settings import ArchiveSettings
from ema_archive.store import Store, insert
from ema_archive.tables import BAG_TABLES, UNIT_TABLES, placed
from ema_archive.unit_task import UnitEntry, UnitResult

_BAGS_OF: Final = "WHERE bag IN (SELECT unnest(?))"
_UNITS_OF: Final = "WHERE unit IN (SELECT unnest(?))"


def commit_bags(store: Store, results: Sequence[BagResult], settings: ArchiveSettings) -> None:
    """Replace the rows of bags and mark their units as due.

    An unreadable bag keeps its earlier rows. If a missing bag has the same content as a result, it
    was moved: its old entry is deleted.

    Raises
    ------
    ValueError, OSError
        As in ``Store.changing``; the store is then unchanged.
    """
    if not results:
        return
    kept = [result for result in results if result.state not in (FAILED, DAMAGED)]
    with store.changing() as db:
        moved = _moved(db, kept)
        replaced = [*(result.task.url for result in kept), *moved]
        db.execute(
            f"UPDATE manifest.unit SET is_due = true WHERE unit IN "
            f"(SELECT unit FROM manifest.part {_BAGS_OF})",
            [replaced],
        )
        if db.execute(f"SELECT 1 FROM manifest.part {_BAGS_OF} LIMIT 1", [replaced]).fetchall():
            for table in ("manifest.part", *BAG_TABLES):
                db.execute(f"DELETE FROM {table} {_BAGS_OF}", [replaced])
        if moved:
            db.execute(f"DELETE FROM manifest.bag {_BAGS_OF}", [moved])
        _note_bags(db, results, settings)
        _add_rows(db, kept)


def _moved(db: duckdb.DuckDBPyConnection, results: Iterable[BagResult]) -> list[str]:
    """Return the addresses of missing bags with the same content as a result."""
    contents = [result.sha256 for result in results]
    query = (
        "SELECT bag FROM manifest.bag WHERE NOT is_there AND bag_sha256 IN (SELECT unnest(?)) "
        "ORDER BY bag"
    )
    return [bag for (bag,) in db.execute(query, [contents]).fetchall()]


def _note_bags(
    db: duckdb.DuckDBPyConnection, results: Sequence[BagResult], settings: ArchiveSettings
) -> None:
    """Record the states of bags."""
    state: dict[str, list[dict[str, Any]]] = {FAILED: [], DAMAGED: [], "": []}
    for result in results:
        row = {"bag": result.task.url, "state": result.state, "reason": result.reason}
        if result.state != FAILED:
            # Without a new mark, a bag that could not be read stays due.
            row |= {"seen": result.task.mark, "software": result.software}
            row |= {"settings": settings.estimation_id}
        if result.state == DAMAGED:
            row |= {"end_ns": result.end_ns}
        if result.state not in (FAILED, DAMAGED):
            estimates = [row for part in result.units for row in part.estimates]
            row |= {
                "bag_sha256": result.sha256,
                "remarks": "; ".join(result.remarks),
                "windows": len(estimates),
                "valid": sum(row["valid"] for row in estimates),
                "end_ns": result.end_ns,
            }
        state[result.state if result.state in state else ""].append(row)
    for kind, rows in state.items():
        if not rows:
            continue
        values = {name: f"_rows.{name}" for name in rows[0] if name != "bag"}
        if kind == DAMAGED:
            # The bag keeps its earlier rows and their time.
            values["end_ns"] = "greatest(bag.end_ns, _rows.end_ns)"
        changes = ", ".join(f"{name} = {value}" for name, value in values.items())
        db.register("_rows", pa.Table.from_pylist(rows))
        db.execute(f"UPDATE manifest.bag SET {changes} FROM _rows WHERE bag.bag = _rows.bag")
        db.unregister("_rows")


def _add_rows(db: duckdb.DuckDBPyConnection, results: Iterable[BagResult]) -> None:
    """Insert the rows of bags, and their units."""
    units = [(result.task.url, part) for result in results for part in result.units]
    if not units:
        return
    parts = [
        {
            "bag": url,
            "unit": part.unit,
            "model": part.model,
            "calibration_id": part.calibration_id,
            "last_ns": max(part.stamps_ns, default=0),
            **{name: len(getattr(part, name)) for name in BAG_TABLES},
        }
        for url, part in units
    ]
    insert(db, "manifest.part", pa.Table.from_pylist(parts))
    names = {part.unit: (part.actuator_id, part.serial_number, part.model) for _, part in units}
    columns = ("unit", "actuator_id", "serial_number", "model")
    rows = [dict(zip(columns, (unit, *of), strict=True)) for unit, of in names.items()]
    db.register("_rows", pa.Table.from_pylist(rows))
    db.execute(
        "MERGE INTO manifest.unit USING _rows USING (unit) WHEN MATCHED THEN UPDATE SET "
        "is_due = true WHEN NOT MATCHED THEN INSERT BY NAME"
    )
    db.unregister("_rows")
    for name, schema in BAG_TABLES.items():
        tables = [
            placed(pa.Table.from_pylist(rows, schema), part.model, part.unit)
            for _, part in units
            if (rows := getattr(part, name))
        ]
        if tables:
            insert(db, name, pa.concat_tables(tables))


def commit_units(store: Store, results: Sequence[tuple[UnitEntry, UnitResult]]) -> None:
    """Replace health, life and history of units.

    Raises
    ------
    ValueError, OSError
        As in ``Store.changing``; the store is then unchanged.
    """
    if not results:
        return
    units = [entry.unit for entry, _ in results]
    with store.changing() as db:
        for table in (*UNIT_TABLES, *HISTORY_TABLES):
            db.execute(f"DELETE FROM {table} {_UNITS_OF}", [units])
        for name in UNIT_TABLES:
            tables = [
                placed(result.tables[name], entry.model, entry.unit) for entry, result in results
            ]
            insert(db, name, pa.concat_tables(tables))
        kept = [(entry, result.kept) for entry, result in results if result.kept]
        for name in HISTORY_TABLES if kept else ():
            tables = [
                placed(result.tables[name], entry.model, entry.unit) for entry, result in kept
            ]
            insert(db, name, pa.concat_tables(tables))
        rows = [
            {
                "unit": entry.unit,
                "model": entry.model,
                "made_by": result.made_by,
                "lost": entry.lost,
                "windows": result.kept.windows if result.kept else 0,
                "digest": result.kept.digest if result.kept else "",
            }
            for entry, result in results
        ]
        changes = ", ".join(f"{name} = _rows.{name}" for name in rows[0] if name != "unit")
        db.register("_rows", pa.Table.from_pylist(rows))
        db.execute(
            f"UPDATE manifest.unit SET is_due = false, {changes} FROM _rows "
            "WHERE unit.unit = _rows.unit"
        )
        db.unregister("_rows")
        # Delete units that are in no bag.
        query = "SELECT unit FROM manifest.unit ANTI JOIN manifest.part USING (unit)"
        if unknown := [unit for (unit,) in db.execute(query).fetchall()]:
            for table in ("manifest.unit", *UNIT_TABLES, *HISTORY_TABLES):
                db.execute(f"DELETE FROM {table} {_UNITS_OF}", [unknown])
