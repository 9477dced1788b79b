# SPDX-License-Identifier: Apache-2.0
"""Repair of damaged archive tables: unreadable rows are marked for recomputation."""

from typing import Final

import duckdb

from ema_archive.store import Store, damage_of
from ema_archive.tables import BAG_TABLES
from ema_core.wording import counted

_ROW_GROUP: Final = 122_880
"""Number of rows that DuckDB stores together."""

_LOST: Final = """
UPDATE manifest.bag SET state = 'lost' FROM (
    SELECT bag, sum(part.{table}) AS written FROM manifest.part GROUP BY bag
) AS part LEFT JOIN (SELECT bag, count(*) AS rows FROM {table} GROUP BY bag) AS now USING (bag)
WHERE bag.bag = part.bag AND written <> coalesce(rows, 0)
"""


def require_whole(store: Store) -> None:
    """Raise ValueError if rows of a table cannot be read."""
    if damaged := store.damaged_tables():
        raise ValueError(
            f"{counted(len(damaged), 'table')} damaged, {', '.join(damaged)}: "
            f"run `ema archive run {store.archive}` to recompute them"
        )


def mend(store: Store) -> list[str]:
    """Keep the readable rows of damaged tables and mark the rest for recomputation.

    Returns
    -------
    list of str
        One message per finding.

    Raises
    ------
    ValueError
        If a table of the manifest is damaged.
    OSError
        If the store cannot be written.
    """
    damaged = store.damaged_tables()
    if not damaged:
        return []
    with store.reading() as db:
        # Before the transaction, because an error would end it.
        readable = {table: _readable(db, table) for table in damaged}
    with store.changing() as db:
        for table, groups in readable.items():
            _replace(db, table, groups)
            if table in BAG_TABLES:
                db.execute(_LOST.format(table=table))
        if set(damaged) - set(BAG_TABLES):
            # Health and history of each unit are recomputed from its first test.
            db.execute("UPDATE manifest.unit SET is_due = true, windows = 0")
        query = "SELECT bag FROM manifest.bag WHERE state = 'lost' AND NOT is_there ORDER BY bag"
        gone = [bag for (bag,) in db.execute(query).fetchall()]
    messages = [f"{counted(len(damaged), 'table')} damaged, {', '.join(damaged)}: recomputed"]
    if gone:
        messages.append(
            f"{counted(len(gone), 'bag')} of these tables are missing, such as {gone[0]}: "
            "restore them and scan again, or their windows are lost"
        )
    return messages


def _readable(db: duckdb.DuckDBPyConnection, table: str) -> list[str]:
    """Return SQL conditions that select the readable row groups of a table."""
    [(last,)] = db.execute(f"SELECT max(rowid) FROM {table}").fetchall()
    groups = [
        f"rowid BETWEEN {first} AND {first + _ROW_GROUP - 1}"
        for first in range(0, 0 if last is None else last + 1, _ROW_GROUP)
    ]
    return [rows for rows in groups if not damage_of(db, f"{table} WHERE {rows}")]


def _replace(db: duckdb.DuckDBPyConnection, table: str, readable: list[str]) -> None:
    """Replace a table with its readable rows."""
    schema, _, name = table.rpartition(".")
    db.execute(f"CREATE TABLE {schema or 'main'}._kept AS SELECT * FROM {table} LIMIT 0")
    for rows in readable:
        db.execute(f"INSERT INTO {schema or 'main'}._kept SELECT * FROM {table} WHERE {rows}")
    db.execute(f"DROP TABLE {table}")
    db.execute(f"ALTER TABLE {schema or 'main'}._kept RENAME TO {name}")
