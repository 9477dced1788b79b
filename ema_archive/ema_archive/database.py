"""The database of an archive: it survives a kill at any moment."""

import fcntl
import sqlite3
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, Final, Self

from ema_archive.partitions import TABLES
from ema_archive.sources import content_digest
from ema_archive.tables import WHOLE
from ema_core.wording import counted

FILE: Final = "archive.sqlite"
"""Name of the database in an archive."""

_VERSION: Final = 9
_TABLES: Final = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
INSERT INTO meta VALUES ('settings', ''), ('sources', '[]'), ('scan', '0');
CREATE TABLE bag (
    url TEXT PRIMARY KEY, size INTEGER NOT NULL, mark TEXT NOT NULL,
    beside TEXT NOT NULL, scan INTEGER NOT NULL, state TEXT NOT NULL DEFAULT 'new',
    seen TEXT NOT NULL DEFAULT '', sha256 TEXT NOT NULL DEFAULT '',
    software TEXT NOT NULL DEFAULT '', settings TEXT NOT NULL DEFAULT '',
    reason TEXT NOT NULL DEFAULT '', remarks TEXT NOT NULL DEFAULT '',
    windows INTEGER NOT NULL DEFAULT 0, valid INTEGER NOT NULL DEFAULT 0,
    end_ns INTEGER NOT NULL DEFAULT 0
) WITHOUT ROWID;
CREATE TABLE part (
    url TEXT NOT NULL, unit TEXT NOT NULL, model TEXT NOT NULL, months TEXT NOT NULL,
    calibration_id TEXT NOT NULL, last_ns INTEGER NOT NULL, windows INTEGER NOT NULL,
    PRIMARY KEY (url, unit, model)
) WITHOUT ROWID;
CREATE INDEX bag_of_content ON bag (sha256);
CREATE INDEX part_of_unit ON part (unit, last_ns);
CREATE TABLE unit (
    unit TEXT PRIMARY KEY, actuator_id TEXT NOT NULL, serial_number TEXT NOT NULL,
    model TEXT NOT NULL, is_due INTEGER NOT NULL, made_by TEXT NOT NULL DEFAULT '',
    summary TEXT NOT NULL DEFAULT '{}'
) WITHOUT ROWID;
CREATE TABLE kept (
    unit TEXT PRIMARY KEY, made_by TEXT, tests INTEGER, digest TEXT, history BLOB
);
CREATE TABLE file (
    path TEXT PRIMARY KEY, unit TEXT NOT NULL, month TEXT NOT NULL,
    size INTEGER NOT NULL, changed_ns INTEGER NOT NULL, sha256 TEXT NOT NULL
) WITHOUT ROWID
"""

_REMEDY: Final = (
    "where it is damaged, scan the bags to a new archive: all that it has is made of them"
)


_PRIMARY_CODE: Final = 0xFF
_NEEDS_WRITING: Final = (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN)

_REPLACED_S: Final = 0.2
"""Time after which a run that replaces a file has noted it [s]."""


class Database(AbstractContextManager[Any, None]):
    """The database of an archive, for one process at a time that changes it (``writes``).

    Raises
    ------
    ValueError
        When there is no archive, it has another version, or another process changes it.
    OSError
        When it cannot be opened; or read, as the block ends.
    """

    def __init__(self, archive: Path, *, is_new: bool = False, writes: bool = True) -> None:
        self.archive, self._path = archive, archive / FILE
        self._lock: Any = None
        self._check(is_new)
        if writes:
            self._lock = (archive / ".lock").open("w", encoding="utf-8")
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                self._lock.close()
                raise ValueError(f"{archive} is being changed by another command") from error
        self._db = sqlite3.connect(self._path, timeout=30.0, isolation_level=None)
        try:
            if not writes:
                self._allow_read_only()
            self._prepare()
        except BaseException as error:
            self._close()
            if isinstance(error, sqlite3.Error | UnicodeDecodeError):
                raise ValueError(f"{self._path} cannot be used: {error}; {_REMEDY}") from error
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        self._close()
        if isinstance(error, sqlite3.DatabaseError | UnicodeDecodeError):
            # Of a read: it is held by another program, or damaged.
            raise OSError(f"{self._path} cannot be used: {error}; {_REMEDY}") from error

    def _close(self) -> None:
        self._db.close()
        if self._lock is not None:
            self._lock.close()

    def _allow_read_only(self) -> None:
        """Open for a reader without permission to write the file or its folder."""
        try:
            # Fails where SQLite cannot make the files that it shares with those that write.
            self._db.execute("SELECT 1 FROM sqlite_master").fetchall()
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & _PRIMARY_CODE not in _NEEDS_WRITING:
                raise
            log = self._path.with_name(f"{FILE}-wal")
            if log.exists() and log.stat().st_size:
                raise OSError(
                    f"{self._path} cannot be read without permission to write: its last changes "
                    f"are in {log.name}; run `ema archive status` with permission to write first"
                ) from None
            # Without these files nobody is changing it: it is read as it is.
            self._db.close()
            url = f"{self._path.resolve().as_uri()}?immutable=1"
            self._db = sqlite3.connect(url, uri=True, isolation_level=None)

    def _check(self, is_new: bool) -> None:
        """Check that there is an archive, or a place for a new one."""
        archive, path = self.archive, self._path
        if path.exists():
            if not path.stat().st_size and (archive / TABLES).exists():
                raise ValueError(f"{path} is empty, although there are tables: {_REMEDY}")
            return
        if not is_new:
            raise ValueError(
                f"{archive} is no archive, it has no {FILE}: `ema archive scan {archive} FOLDER` "
                "makes one"
            )
        if archive.exists() and any(archive.iterdir()):
            raise ValueError(
                f"{archive} is a folder with other files: an archive is made in a new folder"
            )
        archive.mkdir(parents=True, exist_ok=True)

    def _prepare(self) -> None:
        version = self._db.execute("PRAGMA user_version").fetchone()[0]
        if version not in (0, _VERSION):
            raise ValueError(
                f"{self._path} has version {version}, expected {_VERSION}: scan the bags to a new "
                "archive"
            )
        if version == 0:
            self._db.execute("PRAGMA journal_mode = WAL")
            with self._changing():
                for statement in _TABLES.split(";\n"):
                    self._db.execute(statement)
                self._db.execute(f"PRAGMA user_version = {_VERSION}")
        # A kill loses nothing that was committed; a loss of power may lose the last commits, whose
        # bags are then done again.
        self._db.execute("PRAGMA synchronous = NORMAL")

    @contextmanager
    def _changing(self) -> Iterator[sqlite3.Connection]:
        """Change the database in one transaction: all of the block, or nothing.

        Raises
        ------
        OSError
            When it cannot be written.
        """
        try:
            self._db.execute("BEGIN IMMEDIATE")
            with self._db:
                yield self._db
        except sqlite3.OperationalError as error:
            # A full disk, above all; or another program that holds it.
            raise OSError(f"{FILE} cannot be written: {error}") from error

    def _rows(self, query: str, values: Any = ()) -> list[tuple[Any, ...]]:
        return self._db.execute(query, values).fetchall()

    def _count(self, what: str, values: Any = ()) -> int:
        return self._rows(f"SELECT count(*) FROM {what}", values)[0][0]

    def require_tables(self) -> None:
        """Raise ValueError where a file of the tables is missing or damaged."""
        if damaged := self._damaged_files():
            such = damaged[0][0].relative_to(self.archive)
            raise ValueError(
                f"{counted(len(damaged), 'file')} of the tables missing or damaged, such as "
                f"{such}: `ema archive run {self.archive}` makes them anew"
            )

    def _damaged_files(self) -> list[tuple[Path, str, str]]:
        """Return the files that are missing, or not as they were written; their unit and month."""
        damaged = self._files_not_as_noted()
        if damaged:
            time.sleep(_REPLACED_S)
            confirmed = set(self._files_not_as_noted())
            damaged = [one for one in damaged if one in confirmed]
        return damaged

    def _files_not_as_noted(self) -> list[tuple[Path, str, str]]:
        noted = self._rows("SELECT path, unit, month, size, changed_ns, sha256 FROM file")
        damaged = [
            (path, unit, month)
            for name, unit, month, *as_noted in noted
            if not _is_as_noted(path := self.archive / name, *as_noted)
        ]
        names = {name for name, *_ in noted}
        whole = (f"{TABLES}/{name}.parquet" for name in WHOLE)
        # Each scan and run writes these.
        missing = [name for name in whole if name not in names and int(self._get("scan"))]
        return damaged + [(self.archive / name, "", "") for name in missing]

    def _get(self, name: str) -> str:
        return self._rows("SELECT value FROM meta WHERE name = ?", (name,))[0][0]


def _is_as_noted(path: Path, size: int, changed_ns: int, sha256: str) -> bool:
    try:
        stat = path.stat()
    except OSError:
        return False
    # A copy of a file is as it was.
    is_same = stat.st_mtime_ns == changed_ns or content_digest(path) == sha256
    return stat.st_size == size and is_same
