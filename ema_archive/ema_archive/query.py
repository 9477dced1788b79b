"""SQL queries of the tables of an archive, without access to other files or to writing."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import duckdb
import pyarrow as pa

from ema_archive.database import FILE, Database
from ema_archive.partitions import STAMPS, TABLES
from ema_archive.tables import PARTITIONED, WHOLE
from ema_core.files import complete_file

FORMATS: Final = (".csv", ".parquet")
"""Suffixes of the files to which a table is exported."""


@contextmanager
def opened(archive: Path, *, has_tests: bool = True) -> Iterator[duckdb.DuckDBPyConnection]:
    """Yield a connection with a view for each table of an archive, and the ready ones.

    It reads the tables of the archive and no other file, and its settings cannot be changed. Of
    tables without the database of the archive it is not known which files are missing.

    Raises
    ------
    ValueError
        When a file of the tables is missing or damaged, or a query of the block fails: some errors
        occur only while rows are read.
    OSError
        When the database cannot be read.
    """
    if (archive / FILE).exists():
        with Database(archive, writes=False) as database:
            database.require_tables()
    tables = (archive / TABLES).resolve()
    try:
        with duckdb.connect() as db:
            for name, schema in WHOLE.items():
                _make_view(db, name, schema, tables, f"{name}.parquet")
            _execute(db, "unit_views.sql")
            for name, schema in PARTITIONED.items() if has_tests else ():
                keys = ("model", "unit", "month") if name in STAMPS else ("model", "unit")
                pattern = "/".join([name, *("*" for _ in keys), "*.parquet"])
                schema = pa.schema([*schema, *((key, pa.string()) for key in keys)])
                types = ", ".join(f"'{key}': VARCHAR" for key in keys)
                options = f", hive_partitioning = true, hive_types = {{{types}}}"
                _make_view(db, name, schema, tables, pattern, options)
            if has_tests:
                _execute(db, "views.sql")
            db.execute(f"SET allowed_directories = [{_text(f'{tables}/')}]")
            db.execute("SET enable_external_access = false")
            db.execute("SET lock_configuration = true")
            yield db
    except duckdb.Error as error:
        raise ValueError(_first_line(error)) from error


def columns_of(archive: Path) -> dict[str, list[tuple[str, str]]]:
    """Return name and type of each column, by table and view."""
    columns: dict[str, list[tuple[str, str]]] = {}
    with opened(archive) as db:
        for view, column, kind in db.execute(
            "SELECT view_name, column_name, data_type FROM duckdb_views() AS view "
            "JOIN duckdb_columns() ON table_name = view_name WHERE NOT view.internal "
            "ORDER BY view_name, column_index"
        ).fetchall():
            columns.setdefault(view, []).append((column, kind))
    return columns


def answer(archive: Path, question: str) -> tuple[list[str], list[tuple[Any, ...]]]:
    """Return the names of the columns and the rows that a query in SQL gives.

    Raises
    ------
    ValueError
        When it is not a query, or fails.
    """
    with opened(archive) as db:
        relation = _asked(db, question)
        return list(relation.columns), relation.fetchall()


def export(archive: Path, question: str, path: Path) -> int:
    """Write the answer to a query, or a table or view by its name, to a file; return its rows.

    Raises
    ------
    ValueError
        When the query cannot be answered, or the file is of another kind.
    OSError
        When it cannot be written.
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
            raise OSError(f"cannot be written: {_first_line(error)}") from error
    return table.num_rows


def _without_formulas(schema: pa.Schema) -> str:
    """Return columns in SQL with a quote before texts that a spreadsheet would evaluate."""
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
    if [one.type for one in statements] != [duckdb.StatementType.SELECT]:
        names = db.execute("SELECT view_name FROM duckdb_views() WHERE NOT internal ORDER BY 1")
        raise ValueError(
            'expected one query, such as "select * from worst_first limit 20"; tables and views: '
            f"{', '.join(name for (name,) in names.fetchall())}"
        )
    return db.sql(statements[0].query)


def _first_line(error: Exception) -> str:
    return " ".join(str(error).split("\n\n")[0].split())


def _execute(db: duckdb.DuckDBPyConnection, name: str) -> None:
    text = files("ema_archive").joinpath(name).read_text(encoding="utf-8")
    for statement in text.split(";\n"):
        if "CREATE" in statement:
            db.execute(statement)


def _make_view(
    db: duckdb.DuckDBPyConnection,
    name: str,
    schema: pa.Schema,
    tables: Path,
    pattern: str,
    options: str = "",
) -> None:
    """Make a view of files, or a table without rows where there are none."""
    source = f"read_parquet({_text(str(tables / pattern))}{options})"
    if next(tables.glob(pattern), None) is None:
        source = f"_no_{name}"
        db.from_arrow(schema.empty_table()).create(source)
    db.execute(f"CREATE VIEW {name} AS SELECT * FROM {source}")


def _text(words: str) -> str:
    return "'" + words.replace("'", "''") + "'"
