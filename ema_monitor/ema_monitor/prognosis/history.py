# SPDX-License-Identifier: Apache-2.0
"""Crash-safe database with the test history of one unit."""

import os
import shutil
import sqlite3
import threading
import zlib
from bisect import insort
from collections.abc import Callable
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from types import NoneType
from typing import Final
from urllib.parse import quote, unquote

from ema_core.expecting import require_type
from ema_monitor.identification.estimate import Verdict
from ema_monitor.prognosis.duty.damage import FlownDuty
from ema_monitor.prognosis.history_entry import (
    Assessment,
    Entry,
    Test,
    UnusedCycle,
    as_text,
    assessment_text,
    read_assessment,
    read_test,
)

SCHEMA_VERSION: Final = 12
"""``user_version`` of the database."""

_TABLES: Final = """
    CREATE TABLE unit (actuator_id TEXT NOT NULL, serial_number TEXT NOT NULL);
    CREATE TABLE test (number INTEGER PRIMARY KEY AUTOINCREMENT, record TEXT NOT NULL,
        crc32 INTEGER NOT NULL);
    CREATE TABLE assessment (end_ns INTEGER PRIMARY KEY, record TEXT NOT NULL,
        crc32 INTEGER NOT NULL);
    CREATE TABLE growth (state BLOB NOT NULL, crc32 INTEGER NOT NULL);
"""

_LATE_SHARE: Final = 0.05
# SQLITE_ERROR means that tables or columns are missing.
_DAMAGE: Final = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR)


class History:
    """Tests of a unit and their assessments, in memory and, with a path, in a file.

    The file is an SQLite database with a write-ahead log, one transaction per test, and an
    exclusive lock. Checksums cover each test, its unit and its position. If the file is damaged,
    belongs to a different unit, kind or version, or has deleted, repeated or swapped tests, it is
    renamed, and a new file is started with the intact tests. If the file is deleted or moved while
    in use, it is rewritten. File errors never raise exceptions: ``problem`` reports them, and the
    history continues in memory.

    Parameters
    ----------
    actuator_id, serial_number
        The unit.
    path
        Path of the file; None to keep the history in memory only. The first entry creates the file
        and its folder.

    Raises
    ------
    ValueError
        If ``path`` has a wrong type.

    Attributes
    ----------
    unit
        Actuator and serial number.
    tests
        All tests in the order in which they were added.
    entries
        Valid tests in order of their stamps.
    late
        Valid tests that were added late and are not in ``entries`` yet. They are inserted together
        once they exceed 5 % of the entries, because all results after them are then recomputed.
    unused
        Test cycles without a valid estimate after the latest entry, in the order of addition.
    assessments
        Assessment after each valid test, by its stamp [ns].
    growth
        State stored by ``keep_growth``; empty if none was stored.
    path
        The file in use; None if the history is in memory only.
    """

    def __init__(
        self, actuator_id: str, serial_number: str, path: str | Path | None = None
    ) -> None:
        require_type("path", path, (str, Path, NoneType))
        path = Path(path) if path else None
        self.entries: list[Entry] = []
        self.late: list[Entry] = []
        self.unused: list[UnusedCycle] = []
        self.assessments: dict[int, Assessment] = {}
        self.growth = b""
        self.unit = (actuator_id, serial_number)
        self.path = path
        self._lock = threading.RLock()
        self._db: sqlite3.Connection | None = None
        self._file_id = (0, 0)
        self.tests: list[Test] = []
        # Validity of each test by its stamp, and the number of tests in the file.
        self._is_valid: dict[int, bool] = {}
        self._written = 0
        # Stamps of assessments that differ from the file.
        self._changed: set[int] = set()
        self._mended = ""
        self._trouble = ""
        if path is not None and path.exists():
            try:
                self._open(path)
            except (sqlite3.Error, OSError) as error:
                self._read_copy(path, error)

    @property
    def problem(self) -> str:
        """Current or repaired problem with the file; empty if there was none."""
        return "; ".join(filter(None, [self._mended, self._trouble]))

    @property
    def newest(self) -> Test | None:
        """The test with the latest stamp, valid or refused, not skipped; None if there is none."""
        refused = [test for test in self.unused if test.verdict != Verdict.SKIPPED]
        return max([*self.entries[-1:], *refused], key=lambda test: test.stamp_ns, default=None)

    @property
    def unused_duty(self) -> FlownDuty:
        """Duty in the ``unused`` test cycles after the latest entry."""
        return sum((test.flown for test in self.unused), FlownDuty())

    def holds(self, stamp_ns: int) -> bool:
        """Return whether a test whose window ends at ``stamp_ns`` is in the history."""
        return stamp_ns in self._is_valid

    def holds_valid(self, stamp_ns: int) -> bool:
        """Return whether a valid test whose window ends at ``stamp_ns`` is in the history."""
        return self._is_valid.get(stamp_ns, False)

    def time_of(self, end_ns: int) -> int:
        """Return the time by which the test whose window ends at ``end_ns`` is ordered [ns].

        ``end_ns`` is the stamp in the telemetry [ns]. If several tests have it, the last added test
        counts. If no test has it, it is returned.
        """
        latest_first = reversed(self.tests)
        return next((test.stamp_ns for test in latest_first if test.end_ns == end_ns), end_ns)

    def has_failed(self, test: Test) -> bool:
        """Return whether a test shows a failure, and its window has no valid second attempt."""
        return test.verdict == Verdict.FAILED and not self.holds_valid(test.stamp_ns)

    def append(self, test: Test) -> None:
        """Add a test and flush it to disk."""
        with self._lock:
            self._add(test)
            self._write()

    def assess(self, assessment: Assessment) -> None:
        """Add or replace the assessment of a test and flush it to disk."""
        with self._lock:
            self.assessments[assessment.stamp_ns] = assessment
            self._changed.add(assessment.stamp_ns)
            self._write()

    def keep_growth(self, state: bytes) -> None:
        """Store the growth state after all tests so far, if all tests are in the file.

        This only speeds up the next start: the state can be recomputed from the tests.
        """
        with self._lock:
            if self._db is None or self._trouble:
                return
            try:
                with self._db as db:
                    db.execute("BEGIN IMMEDIATE")
                    db.execute("DELETE FROM growth")
                    db.execute("INSERT INTO growth VALUES (?, ?)", (state, zlib.crc32(state)))
            except sqlite3.Error as error:
                self._trouble = f"the history {self.path} cannot be written: {_reason_of(error)}"

    def close(self) -> None:
        """Close the file; later additions are kept in memory only."""
        with self._lock:
            self.path = None
            self._release()

    def _release(self) -> None:
        if self._db is not None:
            self._db.close()
            self._db = None

    def _add(self, test: Test) -> None:
        self.tests.append(test)
        last_ns = self.entries[-1].stamp_ns if self.entries else -1
        if isinstance(test, UnusedCycle):
            self._is_valid.setdefault(test.stamp_ns, False)
            self.unused += [test] if test.stamp_ns > last_ns else []
            return
        self._is_valid[test.stamp_ns] = True
        (self.late if test.stamp_ns < last_ns else self.entries).append(test)
        if len(self.late) > _LATE_SHARE * len(self.entries):
            for late in self.late:
                insort(self.entries, late, key=lambda entry: entry.stamp_ns)
            self.late.clear()
        last_ns = self.entries[-1].stamp_ns
        self.unused = [cycle for cycle in self.unused if cycle.stamp_ns > last_ns]

    def _write(self) -> None:
        """Write everything that is not in the file yet."""
        if self.path is None:
            self._changed.clear()
            return
        try:
            self._write_pending(self.path)
        except (sqlite3.Error, OSError) as error:
            self._trouble = (
                f"the history {self.path} cannot be written: {_reason_of(error)}; "
                "tests since then are in memory only"
            )
        except ValueError:
            self._trouble = (
                f"the history {self.path} was written by another monitor after this monitor "
                "opened it; this monitor keeps its tests in memory only until it is restarted"
            )
            self.close()

    def _write_pending(self, path: Path) -> None:
        """Write everything pending in a transaction; ValueError if the file has unread tests."""
        if self._db is not None and _file_id(path) != self._file_id:
            self._mended = (
                f"the history {path} was deleted or moved while it was in use; a new file with "
                "all its tests was created"
            )
            self._forget_written()
        db = self._db
        if db is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            db = self._connect(path)
            if db.execute("SELECT count(*) FROM test").fetchone()[0]:
                raise ValueError("it contains tests that were not read")
        tests = enumerate(self.tests[self._written :], self._written + 1)
        assessments = (self.assessments[stamp_ns] for stamp_ns in self._changed)
        with db:
            db.execute("BEGIN IMMEDIATE")
            db.executemany(
                "INSERT INTO test VALUES (?, ?, ?)",
                [self._row(number, as_text(test)) for number, test in tests],
            )
            db.executemany(
                "INSERT OR REPLACE INTO assessment VALUES (?, ?, ?)",
                [self._row(item.stamp_ns, assessment_text(item)) for item in assessments],
            )
        self._written = len(self.tests)
        self._changed.clear()
        self._trouble = ""

    def _row(self, key: int, record: str) -> tuple[int, str, int]:
        """Return a row of a table: its key, its record, and a checksum of both and the unit."""
        return key, record, zlib.crc32(f"{self.unit} {key} {record}".encode())

    def _open(self, path: Path) -> None:
        """Read a file. If it is damaged, rename it and write its intact tests to a new file."""
        try:
            self._read(self._connect(path))
        except (sqlite3.DatabaseError, ValueError) as error:
            if isinstance(error, sqlite3.Error) and _code_of(error) not in _DAMAGE:
                raise
            self._set_aside(path, error)
            if self.tests:
                self._write_pending(path)

    def _connect(self, path: Path) -> sqlite3.Connection:
        """Open the database exclusively, and create tables in an empty file. Return the connection.

        Raises
        ------
        sqlite3.Error
            If another process uses the file, or it cannot be written.
        ValueError
            If the file belongs to another unit, or is not a history.
        """
        self._release()
        db = sqlite3.connect(path, timeout=0.0, isolation_level=None, check_same_thread=False)
        # Invalid bytes lead to a wrong checksum: the row is reported and omitted.
        db.text_factory = lambda text: text.decode(errors="replace")
        try:
            # The lock lasts until the connection is closed, or the process ends.
            db.execute("PRAGMA locking_mode = EXCLUSIVE")
            is_new = not db.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0]
            if not is_new:
                self._check_kind(db)
            db.execute("PRAGMA journal_mode = WAL")
            db.execute("PRAGMA synchronous = FULL")
            # Checkpoint after each test, so that the database file alone contains all tests.
            db.execute("PRAGMA wal_autocheckpoint = 1")
            with db:
                # Needed also for an existing file: it shows whether the file can be written.
                db.execute("BEGIN IMMEDIATE")
                if is_new:
                    for statement in filter(str.strip, _TABLES.split(";")):
                        db.execute(statement)
                    db.execute("INSERT INTO unit VALUES (?, ?)", self.unit)
                    db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
        except BaseException:
            db.close()
            raise
        self._db, self._file_id = db, _file_id(path)
        return db

    def _check_kind(self, db: sqlite3.Connection) -> None:
        version = db.execute("PRAGMA user_version").fetchone()[0]
        if version != SCHEMA_VERSION:
            raise ValueError(f"its schema version is {version}, expected {SCHEMA_VERSION}")
        units = db.execute("SELECT actuator_id, serial_number FROM unit").fetchall()
        if units != [self.unit]:
            raise ValueError(f"it belongs to unit {units}, not {self.unit}")

    def _read(self, db: sqlite3.Connection) -> None:
        """Add the intact records of the file; raise ValueError if any are damaged or missing."""
        damage: list[str] = []

        def read(label: str, key: int, record: str, crc32: int, add: Callable[[str], None]) -> None:
            try:
                if (key, record, crc32) != self._row(key, record):
                    raise ValueError("its checksum is wrong")
                add(record)
            except Exception as error:  # an invalid record may raise any type
                damage.append(f"{label} is damaged: {error}")

        def add_test(record: str) -> None:
            self._add(read_test(record))

        def add_assessment(record: str) -> None:
            assessment = read_assessment(record)
            self.assessments[assessment.stamp_ns] = assessment

        try:
            tests = db.execute("SELECT number, record, crc32 FROM test ORDER BY number")
            for number, record, crc32 in tests:
                damage += _missing(self._written, number - 1)
                read(f"test {number}", number, record, crc32, add_test)
                self._written = number
        finally:
            rows = db.execute("SELECT end_ns, record, crc32 FROM assessment")
            for end_ns, record, crc32 in rows:
                label = f"the assessment of the test at {end_ns} ns"
                read(label, end_ns, record, crc32, add_assessment)
        for (last,) in db.execute("SELECT seq FROM sqlite_sequence WHERE name = 'test'"):
            damage += _missing(self._written, last)
        if (result := db.execute("PRAGMA quick_check(1)").fetchone()[0]) != "ok":
            damage.append(f"it is damaged: {result}")
        for state, crc32 in db.execute("SELECT state, crc32 FROM growth"):
            self.growth = state if zlib.crc32(state) == crc32 else b""
        if damage:
            more = f", and {len(damage) - 1} further defects" if len(damage) > 1 else ""
            raise ValueError(f"{damage[0]}{more}")

    def _read_copy(self, path: Path, error: Exception) -> None:
        """Read a file that cannot be opened for writing, as on read-only media, into memory."""
        self.close()
        if _code_of(error) == sqlite3.SQLITE_BUSY:
            self._trouble = (
                f"the history {path} is in use by another monitor; this monitor keeps its tests in "
                "memory only"
            )
            return
        unread = ""
        try:
            if not self.tests:
                with TemporaryDirectory() as folder:
                    self._read(self._connect(_copied(path, folder)))
        except (sqlite3.Error, OSError, ValueError) as damage:
            unread = f"; nor read: {_reason_of(damage)}"
        self._release()
        self._trouble = (
            f"the history {path} cannot be written: {_reason_of(error)}{unread}; "
            "tests from now on are in memory only"
        )

    def _set_aside(self, path: Path, error: Exception) -> None:
        self._forget_written()
        names = (path.with_name(f"{path.stem}.set_aside_{n}{path.suffix}") for n in count(1))
        new_path = next(name for name in names if not name.exists())
        for suffix in ("-wal", ""):
            if (source := _with_suffix(path, suffix)).exists():
                source.rename(_with_suffix(new_path, suffix))
        whole = f" with the {len(self.tests)} intact test cycles" if self.tests else ""
        self._mended = (
            f"the history {path} was renamed to {new_path.name}, and a new file was created"
            f"{whole}: {_reason_of(error)}"
        )

    def _forget_written(self) -> None:
        """Mark all records as unwritten, for a new file."""
        self._release()
        self._written, self._changed = 0, set(self.assessments)


def read_history(path: Path) -> History:
    """Return the history in a file without changing or locking it; a monitor may be using it.

    Parameters
    ----------
    path
        Path of the file, see ``history_path``.

    Raises
    ------
    ValueError
        If the file is not a history, or is damaged; the message names it.
    OSError
        If the file cannot be read.
    """
    history, damage = read_intact_history(path)
    if damage:
        raise ValueError(damage)
    return history


def read_intact_history(path: Path) -> tuple[History, str]:
    """Return the intact records of a history file, and a message about its damage, or "".

    Raises
    ------
    ValueError
        If the file name is not the name of a history.
    OSError
        If the file cannot be read.
    """
    actuator_id, plus, serial_number = path.name.removesuffix(".sqlite").partition("+")
    if not plus or path.suffix != ".sqlite":
        raise ValueError(f"{path}: expected a file name of the form ACTUATOR+SERIAL.sqlite")
    with TemporaryDirectory() as folder:
        copy = _copied(path, folder)
        history = History(unquote(actuator_id), unquote(serial_number), copy)
        history.close()
        return history, history.problem.replace(str(copy), str(path))


def history_path(folder: Path, actuator_id: str, serial_number: str) -> Path:
    """Return the path of a unit's history in a folder."""
    return folder / f"{quote(actuator_id, safe=' ')}+{quote(serial_number, safe=' ')}.sqlite"


def _copied(path: Path, folder: str) -> Path:
    """Copy a file and its write-ahead log, if any, to a folder. Return the path of the copy."""
    copy = Path(folder) / path.name
    for suffix in ("", "-wal"):
        if (source := _with_suffix(path, suffix)).exists():
            shutil.copyfile(source, _with_suffix(copy, suffix))
    return copy


def _missing(before: int, last: int) -> list[str]:
    """Return a message about the tests missing between two numbers; empty if none is missing."""
    if last <= before:
        return []
    if last == before + 1:
        return [f"test {last} is missing"]
    return [f"tests {before + 1} to {last} are missing"]


def _code_of(error: Exception) -> int:
    """Return the primary result code of SQLite; 0 for other errors."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def _reason_of(error: Exception) -> str:
    if _code_of(error) == sqlite3.SQLITE_BUSY:
        return "it is in use by another monitor"
    return getattr(error, "strerror", None) or str(error)


def _with_suffix(path: Path, suffix: str) -> Path:
    """Return a path with a suffix appended to its name."""
    return path.with_name(path.name + suffix)


def _file_id(path: Path) -> tuple[int, int]:
    """Return device and inode of a file; zeros if it does not exist."""
    try:
        status = os.stat(path)
    except FileNotFoundError:
        return 0, 0
    return status.st_dev, status.st_ino
