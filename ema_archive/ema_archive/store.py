# SPDX-License-Identifier: Apache-2.0
"""Store of an archive: one DuckDB file, which stays consistent if a process is killed."""

import fcntl
import re
import threading
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any, Final, Self

import duckdb
import pyarrow as pa

from ema_archive.history_rows import HISTORY_TABLES
from ema_archive.tables import BAG_TABLES, STAMPS, UNIT_TABLES, placed
from ema_core.event_kinds import EventKind
from ema_core.files import complete_file, require_regular_file
from ema_core.levels import LEVEL_NAMES
from ema_monitor.identification.estimate import Verdict
from ema_monitor.reasons import StampsContradict

FILE: Final = "archive.duckdb"
"""File name of the store in an archive."""

TABLES: Final[Mapping[str, pa.Schema]] = {**BAG_TABLES, **UNIT_TABLES, **HISTORY_TABLES}
"""Columns of all tables that can be recomputed from bags: results of bags and units, and
histories."""

REMEDY: Final = (
    "if it is damaged, scan the bags into a new archive: its content is computed from them"
)

_IN_VIEWS: Final = {
    "level_names": list(LEVEL_NAMES),
    "repair": EventKind.REPAIR,
    "step": EventKind.STEP,
    "refused": Verdict.REFUSED,
    "stamps_contradict": StampsContradict.code,
}
"""Values that replace names in ``views.sql``."""

_VERSION: Final = 15
_EARLIER: Final = "archive.sqlite"  # of versions up to 9
_MANIFEST: Final = ("archive", "bag", "part", "unit")
_LOCK: Final = ".lock"
_NOTED: Final = re.compile(r"([0-9a-f]{32}) (\d+ \d+)")
_READER_WAITS_S: Final = 30.0
_WRITER_WAITS_S: Final = 600.0
_BLOCK_BYTES: Final = 16_384
"""DuckDB's smallest block size; each change of a table writes some blocks."""

_LOOK_S: Final = 0.05
_IS_HELD: Final = ("Could not set lock", "Unique file handle conflict")
"""DuckDB's error texts when another process or thread has locked the file."""


class Store(AbstractContextManager[Any, None]):
    """Store of an archive; only one process at a time may change it. Thread-safe.

    The file is open only during a ``reading`` or ``changing`` block, so that other processes can
    read it between the changes of a run.

    Parameters
    ----------
    archive
        Folder of the archive.
    is_new
        Whether to create the archive if there is none.
    writes
        Whether this process changes the archive; it then locks the archive.

    Raises
    ------
    ValueError
        If there is no archive, its version differs, or another process is changing it.
    OSError
        If the file cannot be opened.
    """

    def __init__(self, archive: Path, *, is_new: bool = False, writes: bool = True) -> None:
        self.archive, self.path = archive, archive / FILE
        self._writes = writes
        self._mutex = threading.RLock()
        # An in-memory engine: attaching a file to it takes half the time of a new connection.
        self._engine, self._is_open = _engine(), False
        self._lock: Any = None
        self._id = uuid.uuid4().hex
        self._check(is_new)
        if writes:
            self._take_lock()
        try:
            if not self.path.exists():
                self._create()
            self._check_version()
        except BaseException:
            self._release()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._release()

    def _release(self) -> None:
        self._engine.close()
        if self._lock is not None:
            self._lock.close()

    def _check(self, is_new: bool) -> None:
        """Raise an error if there is no archive and none can be created."""
        archive, path = self.archive, self.path
        for name in (FILE, f"{FILE}.wal", _LOCK):
            _require_file(archive / name)
        if path.exists():
            if not path.stat().st_size:
                raise ValueError(f"{path} is empty: {REMEDY}")
            return
        if (archive / _EARLIER).exists():
            raise ValueError(
                f"{archive / _EARLIER} has a version before {_VERSION}, expected {_VERSION} "
                f"({FILE}): scan the bags into a new archive"
            )
        if not is_new:
            raise ValueError(
                f"{archive} is not an archive, it has no {FILE}: create an archive with `ema "
                f"archive scan {archive} FOLDER`"
            )
        if archive.exists() and any(not _is_left(path) for path in archive.iterdir()):
            raise ValueError(
                f"{archive} is a folder with other files: an archive needs a new folder"
            )
        archive.mkdir(parents=True, exist_ok=True)

    def _take_lock(self) -> None:
        self._lock = (self.archive / _LOCK).open("a", encoding="utf-8")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._lock.close()
            raise ValueError(f"{self.archive} is being changed by another command") from error

    def _create(self) -> None:
        for path in self.archive.iterdir():
            if path.name != _LOCK:
                path.unlink()  # left by a killed process
        with (
            complete_file(self.path) as partial,
            duckdb.connect(partial, config={"default_block_size": str(_BLOCK_BYTES)}) as db,
        ):
            db.execute(_read_sql("layout.sql"))
            for name, schema in TABLES.items():
                db.register("_rows", placed(schema.empty_table(), "", ""))
                db.execute(f"CREATE TABLE {name} AS SELECT * FROM _rows")
                db.unregister("_rows")
            db.execute(Template(_read_sql("views.sql")).substitute(_IN_VIEWS))
            db.execute(
                "INSERT INTO manifest.archive VALUES (?, ?, '', [], 0)", [_VERSION, self._id]
            )
        self._note()

    def _check_version(self) -> None:
        with self.reading() as db:
            try:
                rows = db.execute("SELECT version FROM manifest.archive").fetchall()
                if rows == [(_VERSION,)]:
                    [(self._id,)] = db.execute("SELECT id FROM manifest.archive").fetchall()
            except duckdb.Error as error:
                raise ValueError(self._unusable(error)) from error
        if rows != [(_VERSION,)]:
            version = rows[0][0] if rows else "none"
            raise ValueError(
                f"{self.path} has version {version}, expected {_VERSION}: scan the bags into a new "
                "archive"
            )
        if (noted := self._noted()[0]) not in ("", self._id):
            raise ValueError(
                f"{self.path} belongs to another archive, {self.archive / _LOCK} to archive "
                f"{noted}: restore its own file, or copy the other archive as a folder; {REMEDY}"
            )

    @contextmanager
    def reading(self) -> Iterator[duckdb.DuckDBPyConnection]:
        """Yield a connection for reading; blocks may be nested.

        Raises
        ------
        ValueError
            If the file is damaged.
        OSError
            If it cannot be read, or another program has locked it.
        """
        with self._mutex:
            if self._is_open:
                yield self._engine
                return
            self._attach()
            try:
                yield self._engine
            except duckdb.Error as error:
                raise OSError(self._unusable(error)) from error
            finally:
                self._detach()

    @contextmanager
    def changing(self) -> Iterator[duckdb.DuckDBPyConnection]:
        """Yield a connection that changes the store in one transaction.

        Raises
        ------
        ValueError
            If the file is damaged.
        OSError
            If it cannot be written, or another program has locked it.
        """
        with self._mutex:
            self._attach()
            try:
                db = self._engine
                db.execute("BEGIN")
                yield db
                db.execute("COMMIT")
                # The recorded size and time must be those on disk.
                db.execute("CHECKPOINT")
                self._note()
            except duckdb.Error as error:
                # Usually a full disk. Uncommitted changes are rolled back.
                raise OSError(f"{self.path} cannot be written: {first_line(error)}") from error
            finally:
                self._detach()

    def _attach(self) -> None:
        """Open the file, waiting briefly for other programs to unlock it."""
        waits_s = _WRITER_WAITS_S if self._writes else _READER_WAITS_S
        end_s, mode = time.monotonic() + waits_s, "" if self._writes else "(READ_ONLY)"
        path = str(self.path.resolve()).replace("'", "''")
        while not self._is_open:
            try:
                self._engine.execute(f"ATTACH '{path}' AS archive {mode}")
                self._is_open = True
            except duckdb.Error as error:
                if not any(text in str(error) for text in _IS_HELD):
                    raise ValueError(self._unusable(error)) from error
                if time.monotonic() > end_s:
                    text = f"{self.path} is in use by another program: {first_line(error)}"
                    raise OSError(text) from error
                time.sleep(_LOOK_S)
        self._engine.execute("USE archive")

    def _detach(self) -> None:
        """Close the file and roll back uncommitted changes."""
        db, self._is_open = self._engine, False
        with suppress(duckdb.TransactionException):
            db.execute("ROLLBACK")
        try:
            db.execute("USE memory")
            db.execute("DETACH archive")
        except duckdb.Error:
            # After an error such as a full disk, DuckDB may have closed the file.
            with suppress(duckdb.Error):
                db.close()
            self._engine = _engine()

    def _unusable(self, error: Exception | str) -> str:
        text = error if isinstance(error, str) else first_line(error)
        return f"{self.path} cannot be used: {text}; {REMEDY}"

    def _note(self) -> None:
        """Record size and time of the file after a write, and the identity of the archive."""
        self._lock.truncate(0)
        self._lock.write(f"{self._id} {_marks(self.path)}")
        self._lock.flush()

    def _noted(self) -> tuple[str, str]:
        """Return the recorded identity and marks of the file; "" if unknown."""
        with suppress(OSError, UnicodeDecodeError):
            text = (self.archive / _LOCK).read_text(encoding="utf-8")
            if noted := _NOTED.fullmatch(text):
                return noted[1], noted[2]
        return "", ""

    def damaged_tables(self) -> list[str]:
        """Return the tables with unreadable rows.

        The whole file is checked by its checksums, unless it is unchanged since it was written.

        Raises
        ------
        ValueError
            If a table of the manifest is damaged.
        """
        if self._noted()[1] == _marks(self.path):
            return []
        with self.reading() as db:
            for name in _MANIFEST:
                if error := damage_of(db, f"manifest.{name}"):
                    raise ValueError(self._unusable(error))
            return [name for name in TABLES if damage_of(db, name)]

    def rows_of_unit(self, table: str, unit: str) -> pa.Table:
        """Return all rows of a unit in a table, in chronological order.

        Raises
        ------
        ValueError, OSError
            As in `reading`.
        """
        schema = TABLES[table]
        names = [STAMPS[table], "bag"] if table in STAMPS else ["tested_ns", "stamp_ns"]
        names.append("number")
        order = ", ".join(name for name in names if name in schema.names) or "ALL"
        columns = ", ".join(f'"{name}"' for name in schema.names)
        with self.reading() as db:
            query = f"SELECT {columns} FROM {table} WHERE unit = ? ORDER BY {order}"
            return db.execute(query, [unit]).to_arrow_table().cast(schema)


def _engine() -> duckdb.DuckDBPyConnection:
    db = duckdb.connect()
    # A progress bar would appear among the rows that a command prints.
    db.execute("SET enable_progress_bar = false")
    return db


def insert(db: duckdb.DuckDBPyConnection, table: str, rows: pa.Table) -> None:
    """Insert rows into a table by column name."""
    db.register("_rows", rows)
    db.execute(f"INSERT INTO {table} BY NAME SELECT * FROM _rows")
    db.unregister("_rows")


def first_line(error: Exception) -> str:
    """Return the first line of a DuckDB error message."""
    return " ".join(str(error).split("\n\n")[0].split())


def damage_of(db: duckdb.DuckDBPyConnection, rows: str) -> str:
    """Return why rows cannot be read, or "" if they can.

    ``rows`` is the name of a table, optionally with a condition (``WHERE ...``).
    """
    try:
        db.execute(f"SELECT bit_xor(hash(COLUMNS(*))) FROM {rows}").fetchall()
    except duckdb.Error as error:
        return first_line(error)
    return ""


def _require_file(path: Path) -> None:
    """Raise an error if an archive file exists and is not a regular file."""
    try:
        require_regular_file(path)
    except OSError:
        # Missing, or DuckDB reports why it cannot be read.
        return
    except ValueError as error:
        raise ValueError(f"{error}: {REMEDY}") from error


def _marks(path: Path) -> str:
    stat = path.stat()
    return f"{stat.st_size} {stat.st_mtime_ns}"


def _is_left(path: Path) -> bool:
    """Return whether a file was left by an interrupted creation of an archive."""
    return path.name == _LOCK or path.name.startswith(f"{FILE}.partial")


def _read_sql(name: str) -> str:
    return files("ema_archive").joinpath(name).read_text(encoding="utf-8")
