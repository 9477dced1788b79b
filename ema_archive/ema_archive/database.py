"""The database of an archive: it survives a kill at any moment."""

import fcntl
import sqlite3
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Final, Self

from ema_archive.partitions import TABLES

FILE: Final = "archive.sqlite"
"""Name of the database in an archive."""

_VERSION: Final = 4
_TABLES: Final = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE bag (
    url TEXT PRIMARY KEY, size INTEGER NOT NULL, mark TEXT NOT NULL,
    beside TEXT NOT NULL, scan INTEGER NOT NULL, state TEXT NOT NULL DEFAULT 'new',
    seen TEXT NOT NULL DEFAULT '', sha256 TEXT NOT NULL DEFAULT '',
    software TEXT NOT NULL DEFAULT '', settings TEXT NOT NULL DEFAULT '',
    reason TEXT NOT NULL DEFAULT '', remarks TEXT NOT NULL DEFAULT '',
    windows INTEGER NOT NULL DEFAULT 0, valid INTEGER NOT NULL DEFAULT 0
) WITHOUT ROWID;
CREATE TABLE part (
    url TEXT NOT NULL, unit TEXT NOT NULL, model TEXT NOT NULL, source TEXT NOT NULL,
    calibration_id TEXT NOT NULL, months TEXT NOT NULL, last_ns INTEGER NOT NULL,
    PRIMARY KEY (url, unit, model)
) WITHOUT ROWID;
CREATE INDEX bag_of_content ON bag (sha256);
CREATE INDEX part_of_unit ON part (unit, last_ns);
CREATE TABLE unit (
    unit TEXT PRIMARY KEY, actuator_id TEXT NOT NULL, serial_number TEXT NOT NULL,
    model TEXT NOT NULL, is_due INTEGER NOT NULL, made_by TEXT NOT NULL DEFAULT '',
    latest TEXT, growth TEXT NOT NULL DEFAULT '[]', record TEXT NOT NULL DEFAULT '{}'
) WITHOUT ROWID;
CREATE TABLE file (
    path TEXT PRIMARY KEY, size INTEGER NOT NULL, changed_ns INTEGER NOT NULL, sha256 TEXT NOT NULL
) WITHOUT ROWID;
CREATE TEMP TABLE current (source TEXT, unit TEXT, id TEXT, PRIMARY KEY (source, unit))
    WITHOUT ROWID;
"""

_REMEDY: Final = (
    "where it is damaged, scan the bags to a new archive: all that it has is made of them"
)


class Database(AbstractContextManager[Any, None]):
    """The database of an archive.

    Parameters
    ----------
    archive
        Folder of the archive.
    is_new
        Whether the folder and the database may be made.
    writes
        Whether it is to be changed: one process at a time may.

    Raises
    ------
    ValueError
        When there is no archive, it is of another version, or another process changes it.
    OSError
        When it cannot be opened; or read, as the block ends.
    """

    def __init__(self, archive: Path, *, is_new: bool = False, writes: bool = True) -> None:
        path = archive / FILE
        if path.exists() and not path.stat().st_size and (archive / TABLES).exists():
            raise ValueError(f"{path} is empty, although there are tables: {_REMEDY}")
        if not path.exists():
            if not is_new:
                raise ValueError(
                    f"{archive} is no archive, it has no {FILE}: `ema archive scan {archive} "
                    "FOLDER` makes one"
                )
            if archive.exists() and any(archive.iterdir()):
                raise ValueError(
                    f"{archive} is a folder with other files: an archive is made in a new folder"
                )
            archive.mkdir(parents=True, exist_ok=True)
        self.archive = archive
        self._lock: Any = None
        if writes:
            self._lock = (archive / ".lock").open("w")
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                self._lock.close()
                raise ValueError(f"{archive} is being changed by another command") from error
        self._db = sqlite3.connect(path, timeout=30.0, isolation_level=None)
        try:
            self._prepare(path)
        except BaseException as error:
            self._close()
            if isinstance(error, sqlite3.Error | UnicodeDecodeError):
                raise ValueError(f"{path} cannot be used: {error}; {_REMEDY}") from error
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        self._close()
        if isinstance(error, sqlite3.DatabaseError | UnicodeDecodeError):
            # Of a read: it is held by another program, or damaged.
            words = f"{self.archive / FILE} cannot be used: {error}; {_REMEDY}"
            raise OSError(words) from error

    def _close(self) -> None:
        self._db.close()
        if self._lock is not None:
            self._lock.close()

    def _prepare(self, path: Path) -> None:
        db = self._db
        version = db.execute("PRAGMA user_version").fetchone()[0]
        if version not in (0, _VERSION):
            raise ValueError(
                f"{path} has version {version}, expected {_VERSION}: scan the bags to a new archive"
            )
        *tables, current = _TABLES.split(";\n")[:-1]
        if version == 0:
            db.execute("PRAGMA journal_mode = WAL")
            with transaction(db):
                for statement in tables:
                    db.execute(statement)
                db.execute(f"PRAGMA user_version = {_VERSION}")
        # A kill loses nothing that was committed; a loss of power may lose the last commits, whose
        # bags are then done again.
        db.execute("PRAGMA synchronous = NORMAL")
        db.execute(current)

    @property
    def there(self) -> str:
        """Condition of bags that the last scan has found."""
        return f"(scan >= {int(self._get('scan', '0'))})"

    def _count(self, what: str, values: Any = ()) -> int:
        return self._db.execute(f"SELECT count(*) FROM {what}", values).fetchone()[0]

    def _get(self, name: str, default: str) -> str:
        row = self._db.execute("SELECT value FROM meta WHERE name = ?", (name,)).fetchone()
        return row[0] if row else default

    def _set(self, name: str, value: str) -> None:
        self._db.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (name, value))


class transaction(AbstractContextManager[None, None]):
    """A transaction of a database in autocommit mode: all of its block, or nothing.

    Parameters
    ----------
    kind
        When the database is locked: "IMMEDIATE", or "DEFERRED" until it is changed.

    Raises
    ------
    OSError
        When it cannot be written.
    """

    def __init__(self, db: sqlite3.Connection, kind: str = "IMMEDIATE") -> None:
        self._db, self._kind = db, kind

    def __enter__(self) -> None:
        try:
            self._db.execute(f"BEGIN {self._kind}")
        except sqlite3.OperationalError as error:
            raise OSError(f"{FILE} cannot be written: {error}") from error

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        if error is None:
            try:
                self._db.execute("COMMIT")
            except sqlite3.Error as failure:
                error = failure
        if error is not None and self._db.in_transaction:
            self._db.execute("ROLLBACK")
        if isinstance(error, sqlite3.OperationalError):
            # A full disk, above all; or another program that holds it.
            raise OSError(f"{FILE} cannot be written: {error}") from error
