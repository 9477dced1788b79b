# SPDX-License-Identifier: Apache-2.0
"""Read-only SQL queries on the tables of an archive, without access to other files."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import duckdb
import pyarrow as pa

from ema_archive.mending import require_whole
from ema_archive.store import Store, first_line
from ema_core.files import complete_file

FORMATS: Final = (".csv", ".parquet")
"""Suffixes of the files to which a table is exported."""


@contextmanager
def opened(archive: Path) -> Iterator[duckdb.DuckDBPyConnection]:
    """Yield a connection to the tables and views of an archive.

    The connection can read only the tables of the archive, and its settings are locked.

    Raises
    ------
    ValueError
        If there is no archive, a table is damaged, or a query in the block fails: some errors occur
        only while rows are read.
    OSError
        If another program has locked the archive.
    """
    with Store(archive, writes=False) as store, store.reading() as db:
        require_whole(store)
        try:
            db.execute("SET enable_external_access = false")
            db.execute("SET lock_configuration = true")
            yield db
        except duckdb.Error as error:
            raise ValueError(first_line(error)) from error


def columns_of(archive: Path) -> dict[str, list[tuple[str, str]]]:
    """Return the names and types of the columns, keyed by the name of the table or view."""
    columns: dict[str, list[tuple[str, str]]] = {}
    with opened(archive) as db:
        for table, column, kind in db.execute(
            "SELECT table_name, column_name, data_type FROM duckdb_columns() "
            "WHERE NOT internal AND schema_name = 'main' ORDER BY table_name, column_index"
        ).fetchall():
            columns.setdefault(table, []).append((column, kind))
    return columns


def answer(archive: Path, question: str) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Run an SQL query and return the column names and the rows.

    Raises
    ------
    ValueError
        If ``question`` is not a query, or the query fails.
    """
    with opened(archive) as db:
        relation = _asked(db, question)
        return list(relation.columns), relation.fetchall()


def export(archive: Path, question: str, path: Path) -> int:
    """Write a query result, table or view to a file and return the number of rows.

    ``question`` is an SQL query, or the name of a table or view.

    Raises
    ------
    ValueError
        If the query fails, or the suffix of the file is not supported.
    OSError
        If the file cannot be written.
    """
    if path.suffix not in FORMATS:
        raise ValueError(f"{path}: expected a name that ends in {' or '.join(FORMATS)}")
    if question.isidentifier():
        question = f"SELECT * FROM {question}"
    with opened(archive) as db:
        table = _asked(db, question).to_arrow_table()
    with complete_file(path) as partial, duckdb.connect() as db:
        rows = db.from_arrow(table)
        try:
            if path.suffix == ".csv":
                rows.project(_without_formulas(table.schema)).write_csv(str(partial))
            else:
                rows.write_parquet(str(partial), compression="zstd")
        except duckdb.IOException as error:
            raise OSError(f"cannot be written: {first_line(error)}") from error
    return table.num_rows


def _without_formulas(schema: pa.Schema) -> str:
    """Return SQL columns that quote strings which a spreadsheet would evaluate as formulas."""
    columns = []
    for column in schema:
        name = '"' + column.name.replace('"', '""') + '"'
        if pa.types.is_string(column.type):
            is_computed = f"regexp_matches({name}, '^[=+@\\t\\r-]')"
            name = f"CASE WHEN {is_computed} THEN chr(39) || {name} ELSE {name} END AS {name}"
        columns.append(name)
    return ", ".join(columns)


def _asked(db: duckdb.DuckDBPyConnection, question: str) -> duckdb.DuckDBPyRelation:
    statements = db.extract_statements(question)
    if [statement.type for statement in statements] != [duckdb.StatementType.SELECT]:
        names = db.execute(
            "SELECT DISTINCT table_name FROM duckdb_columns() "
            "WHERE NOT internal AND schema_name = 'main' ORDER BY 1"
        )
        raise ValueError(
            'expected one query, such as "select * from worst_first limit 20"; tables and views: '
            f"{', '.join(name for (name,) in names.fetchall())}"
        )
    return db.sql(statements[0].query)
