"""The history of one unit, test by test, in a database that survives a kill at any moment."""

import sqlite3
import threading
from array import array
from bisect import bisect_left, insort
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from urllib.parse import quote, unquote

from ema_monitor.duty.flown import FlownDuty, together
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.assessment import Assessment
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.prognosis.history_files import (
    code_of,
    copy_database,
    file_id,
    free_name,
    reason_of,
    with_suffix,
)
from ema_monitor.prognosis.history_import import import_lines
from ema_monitor.prognosis.history_tables import (
    Test,
    check_kind,
    empty,
    insert_assessments,
    insert_tests,
    prepare,
    read_assessments,
    read_growth,
    read_test,
    read_tests,
    write_growth,
)
from ema_monitor.prognosis.kept_assessments import KeptAssessments
from ema_monitor.prognosis.kept_entries import LATEST, KeptEntries

_CACHE_KIB: Final = 128
# The third: tables or columns are missing.
_DAMAGE: Final = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR)


class History:
    """Tests of one unit and what followed from each, in memory and, with a path, in a file.

    The file is an SQLite database with a write-ahead log, one transaction a test, locked for this
    process alone, and each test is linked to those before it by a hash. A file that is damaged, of
    another unit or of another kind, or in which tests were deleted, doubled or swapped, is set
    aside under another name, and a new one begun with the tests that are intact; one that is
    deleted or moved while in use is written anew. A file of an earlier version beside it is
    imported once. Nothing here raises because of a file: ``problem`` says what is wrong, and the
    history goes on in memory.

    Parameters
    ----------
    actuator_id, serial_number
        The unit.
    path
        The file; None for memory alone. It and its folder are made with the first entry.
    spares_memory
        Whether estimates, duty and assessments of all but the latest 20 tests are kept in the file
        alone, from the next test on, and read from there when they are asked for; after ``close``
        they are not to be had any more. Test cycles without an estimate are in the file alone in
        any case.

    Attributes
    ----------
    unit
        Actuator and serial number.
    entries
        The valid tests in the order in which they came.
    unused_cycles
        How many test cycles since the latest of them had no valid estimate.
    unused_duty
        Duty in these; None when it is not known.
    assessments
        What was found after each valid test, by its stamp [ns]; tests of a file of schema version
        3 have none.
    growth
        What was known of growth by ``keep_growth``; empty when nothing.
    imported
        What was imported from a file of an earlier version; empty when nothing.
    path
        The file in use; None when the history is in memory alone.
    """

    def __init__(
        self,
        actuator_id: str,
        serial_number: str,
        path: Path | None = None,
        *,
        spares_memory: bool = False,
    ) -> None:
        self.entries = KeptEntries(self)
        self.unused_cycles = 0
        self.unused_duty: FlownDuty | None = None
        self.assessments = KeptAssessments()
        self.growth = b""
        self.imported = ""
        self.unit = (actuator_id, serial_number)
        self.path = path
        self._spares_memory = spares_memory
        self._lock = threading.RLock()
        self._db: sqlite3.Connection | None = None
        self._file_id = (0, 0)
        # End of the chain in the file.
        self._head = empty(self.unit)
        # How many tests there are, their stamps in ascending order, and those not in the file.
        self._tests = 0
        self._stamps_ns = array("q")
        self._unwritten: list[Test] = []
        # Stamps of assessments that are not in the file as they are here.
        self._changed: dict[int, None] = {}
        self._mended = ""
        self._trouble = ""
        if path is not None:
            try:
                self._open(path)
            except (sqlite3.Error, OSError) as error:
                self._read_copy(path, error)

    @property
    def problem(self) -> str:
        """What is wrong, or was with the file; empty when nothing."""
        return "; ".join(filter(None, [self._mended, self._trouble]))

    def holds(self, stamp_ns: int) -> bool:
        """Return whether the window that ends at a stamp [ns] is in the history, valid or not."""
        # Another thread may be putting another one in its place.
        stamps_ns = self._stamps_ns
        place = bisect_left(stamps_ns, stamp_ns)
        return place < len(stamps_ns) and stamps_ns[place] == stamp_ns

    def holds_valid(self, stamp_ns: int) -> bool:
        """Return whether a valid test of the window that ends at a stamp [ns] is."""
        return self.holds(stamp_ns) and any(
            entry.stamp_ns == stamp_ns for entry in reversed(self.entries)
        )

    def append(self, test: Test) -> None:
        """Add a test, and wait until the disk has it."""
        with self._lock:
            self._add(test)
            self._write()
            self._leave_entries()

    def read_estimate(self, entry: Entry) -> Estimate:
        """Return the estimate of a valid test that is left to the file.

        Raises
        ------
        ValueError
            When it cannot be read.
        """
        return self._left(entry).estimate

    def read_duty(self, entry: Entry) -> FlownDuty | None:
        """Return the duty before a test that is left to the file; None where it is not known.

        Raises
        ------
        ValueError
            When it cannot be read.
        """
        return self._left(entry).flown

    def _left(self, entry: Entry) -> Entry:
        """Return a test as it is in the file; ``ValueError`` when it cannot be read."""
        test = self._in_file(entry.number)
        if not isinstance(test, Entry) or test.stamp_ns != entry.stamp_ns:
            raise ValueError(f"test {entry.number} of {self.unit} is another one in the file")
        return test

    def _in_file(self, number: int) -> Test:
        with self._lock:
            reason = "it is closed"
            try:
                if self._db is not None:
                    return read_test(self._db, number)
            except (sqlite3.Error, ValueError, KeyError, TypeError) as error:
                reason = reason_of(error)
            raise ValueError(f"test {number} of {self.unit} cannot be read: {reason}")

    def assess(self, assessment: Assessment) -> None:
        """Add what was found after a test, or replace it; ``write_assessments`` writes it."""
        with self._lock:
            self.assessments.put(assessment)
            self._changed[assessment.stamp_ns] = None

    def write_assessments(self) -> None:
        """Write the assessments that are not in the file, and wait until the disk has them."""
        with self._lock:
            if self._changed:
                self._write(with_assessments=True)

    def keep_growth(self, state: bytes) -> None:
        """Write what is known of growth by all tests so far, if these are in the file.

        It spares a later start to find it anew. It is no part of the history: losing it costs time
        alone.
        """
        with self._lock:
            if self._db is None or self._head.tests != self._tests or self._trouble:
                return
            try:
                write_growth(self._db, self._head, state)
            except sqlite3.Error as error:
                self._trouble = f"the history {self.path} cannot be written: {reason_of(error)}"

    def _write(self, *, with_assessments: bool = False) -> None:
        if self.path is None:
            self._changed.clear()
            return
        try:
            self._write_pending(self.path)
            if with_assessments:
                self._write_changed(self.path)
        except (sqlite3.Error, OSError) as error:
            self._trouble = (
                f"the history {self.path} cannot be written: {reason_of(error)}; "
                "tests since then are in memory only"
            )
        except ValueError:
            self._trouble = (
                f"the history {self.path} was written by another monitor since this one "
                "began; this one's is in memory only until it starts again"
            )
            self._keep_to_memory()

    def close(self) -> None:
        """Release the file; what is added from now on is in memory only."""
        with self._lock:
            self._keep_to_memory(for_good=True)

    def _keep_to_memory(self, *, for_good: bool = False) -> None:
        self.path = None
        self._release(for_good=for_good)
        self._unwritten = []

    def _add(self, test: Test) -> None:
        insort(self._stamps_ns, test.stamp_ns)
        self._tests += 1
        if self.path is not None:
            self._unwritten.append(test)
        if isinstance(test, Entry):
            test.number = self._tests
            self.entries.append(test)
            self.unused_cycles, self.unused_duty = 0, None
        else:
            self.unused_cycles += 1
            self.unused_duty = together(self.unused_duty, test.flown)

    def _leave_entries(self) -> None:
        """Leave earlier tests to the file, as far as it has them."""
        if self._spares_memory and self._db is not None:
            self.entries.leave(self._head.tests)

    def _leave_assessments(self) -> None:
        """Leave earlier assessments to the file, which has all."""
        if self._spares_memory and self._db is not None:
            self.assessments.leave(LATEST, self._assessment_of)

    def _assessment_of(self, stamp_ns: int) -> Assessment | None:
        """Return an assessment in the file; None when there is none that can be read."""
        with self._lock:
            try:
                if self._db is not None:
                    return next(read_assessments(self._db, stamp_ns, stamp_ns), None)
            except (sqlite3.Error, ValueError, KeyError, TypeError) as error:
                self._trouble = f"the history {self.path} cannot be read: {reason_of(error)}"
            return None

    def _take_back(self) -> None:
        """Keep in memory again what is in the file alone; leave out what cannot be read."""
        self.assessments.take_back()
        tests: list[Test] = []
        lost: list[str] = []
        kept = self.entries.in_memory()
        for number in range(1, self._head.tests + 1):
            try:
                test = kept.get(number) or self._in_file(number)
            except ValueError as error:
                lost.append(str(error))
                continue
            if isinstance(test, Entry) and number not in kept:
                test.pack()
            tests.append(test)
        if lost:
            more = f", and {len(lost) - 1} more" if len(lost) > 1 else ""
            self._mended = "; ".join(filter(None, [self._mended, f"{lost[0]}{more}"]))
        tests += self._unwritten
        self._tests, self._unwritten = len(tests), tests
        self._stamps_ns = array("q", sorted(test.stamp_ns for test in tests))
        entries: list[Entry] = []
        for number, test in enumerate(tests, 1):
            if isinstance(test, Entry):
                test.number = number
                entries.append(test)
        self.entries.take_back(entries)

    def _release(self, *, for_good: bool = False) -> None:
        """Close the file; what was left to it is read before, unless nobody will ask."""
        if self._db is not None:
            if not for_good:
                self._take_back()
            self._db.close()
            self._db = None

    def _open(self, path: Path) -> None:
        """Read a file that is there, or import one of an earlier version."""
        earlier = path.with_suffix(".jsonl")
        if path.exists():
            try:
                db = self._connect(path)
                self._read(db)
                self._leave_assessments()
            except (sqlite3.DatabaseError, ValueError, KeyError, TypeError) as error:
                if isinstance(error, sqlite3.Error) and code_of(error) not in _DAMAGE:
                    raise
                self._set_aside(path, error)
        if not self._tests and not self._mended and earlier.exists():
            tests, self.imported = import_lines(earlier, *self.unit)
            for test in tests:
                self._add(test)
        if self._unwritten:
            self._insert(self._db or self._connect(path), self._unwritten)
            self._write_changed(path)

    def _connect(self, path: Path) -> sqlite3.Connection:
        """Open the database for this process alone, and make its tables if it has none.

        Raises
        ------
        sqlite3.Error
            When another process has it, or it cannot be written.
        ValueError
            When it is of another unit or kind.
        """
        self._release()
        db = sqlite3.connect(
            path,
            timeout=0.0,
            isolation_level=None,
            check_same_thread=False,
            # Each that is kept would keep a copy of its values: of what is known of growth 0.9 MB.
            cached_statements=0,
        )
        # A text that is none has a wrong checksum, and is told and left out by it.
        db.text_factory = lambda text: text.decode(errors="replace")
        try:
            # Held until the connection is closed, or the process ends.
            db.execute("PRAGMA locking_mode = EXCLUSIVE")
            check_kind(db, self.unit)
            db.execute("PRAGMA journal_mode = WAL")
            db.execute("PRAGMA synchronous = FULL")
            # After each test: a copy or a move of the file alone has all tests.
            db.execute("PRAGMA wal_autocheckpoint = 1")
            # Nothing is read often; by default 2 MB of a file stay in memory.
            db.execute(f"PRAGMA cache_size = -{_CACHE_KIB}")
            prepare(db, self.unit)
        except BaseException:
            db.close()
            raise
        self._db, self._file_id = db, file_id(path)
        return db

    def _read(self, db: sqlite3.Connection) -> None:
        """Add what is intact in the file; raise for the rest."""
        try:
            head = read_tests(db, self.unit, self._add)
        finally:
            for one in read_assessments(db):
                self.assessments.put(one)
        if (result := db.execute("PRAGMA quick_check(1)").fetchone()[0]) != "ok":
            raise ValueError(f"it is damaged: {result}")
        self._head = head
        self._unwritten.clear()
        self.growth = read_growth(db)

    def _read_copy(self, path: Path, error: Exception) -> None:
        """Read a file that cannot be opened for writing, as on read-only media; keep to memory."""
        self._keep_to_memory()
        if code_of(error) == sqlite3.SQLITE_BUSY:
            self._trouble = (
                f"the history {path} is in use by another monitor; this one's is in memory only"
            )
            return
        unread = ""
        try:
            if not self._tests:
                self._read_in_copy(path)
        except (sqlite3.Error, OSError, ValueError, KeyError, TypeError) as damage:
            unread = f"; nor read: {reason_of(damage)}"
        self._trouble = (
            f"the history {path} cannot be written: {reason_of(error)}{unread}; "
            "tests from now on are in memory only"
        )

    def _read_in_copy(self, path: Path) -> None:
        """Read a copy of a file and its log, if there is one."""
        with TemporaryDirectory() as folder, closing(self):
            copy = Path(folder) / path.name
            copy_database(path, copy)
            if copy.exists():
                self._read(self._connect(copy))

    def _set_aside(self, path: Path, error: Exception) -> None:
        self._release()
        self._forget_written()
        aside = free_name(path)
        for suffix in ("-wal", ""):
            if (source := with_suffix(path, suffix)).exists():
                source.rename(with_suffix(aside, suffix))
        kept = f" with the {self._tests} test cycles that are intact" if self._tests else ""
        self._mended = (
            f"the history {path} is set aside as {aside.name} and a new one is begun{kept}: "
            f"{reason_of(error)}"
        )

    def _write_pending(self, path: Path) -> None:
        if self._db is not None and file_id(path) != self._file_id:
            self._mended = (
                f"the history {path} was deleted or moved while it was in use; a new file with "
                "all its tests is begun"
            )
            self._release()
            self._forget_written()
        if self._db is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            if self._connect(path).execute("SELECT count(*) FROM test").fetchone()[0]:
                raise ValueError("it holds tests that were not read")
        while self._unwritten:
            self._insert(self._db or self._connect(path), self._unwritten[:1])
        self._trouble = ""

    def _write_changed(self, path: Path) -> None:
        """Write the assessments that are not in the file, in one transaction."""
        insert_assessments(
            self._db or self._connect(path), [self.assessments[stamp] for stamp in self._changed]
        )
        self._changed.clear()
        self._leave_assessments()

    def _forget_written(self) -> None:
        """Note that nothing is in the file that is used from now on."""
        self._head = empty(self.unit)
        self._changed = dict.fromkeys(self.assessments)

    def _insert(self, db: sqlite3.Connection, tests: list[Test]) -> None:
        """Add the first of the tests that are not in the file to it, in one transaction."""
        self._head = insert_tests(db, self._head, tests)
        del self._unwritten[: len(tests)]


def read_history(path: Path) -> History:
    """Return the history in a file, which is neither changed nor kept from a monitor that has it.

    Parameters
    ----------
    path
        The file, as ``history_path`` names it.

    Raises
    ------
    ValueError
        When it is no history, or is damaged; the message names it.
    OSError
        When it cannot be read.
    """
    actuator_id, plus, serial_number = path.name.removesuffix(".sqlite").partition("+")
    if not plus or path.suffix != ".sqlite":
        raise ValueError(f"{path}: expected a history named ACTUATOR+SERIAL.sqlite")
    with TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        copy_database(path, copy)
        history = History(unquote(actuator_id), unquote(serial_number), copy)
        history.close()
        if history.problem:
            raise ValueError(history.problem.replace(str(copy), str(path)))
        return history


def history_path(folder: Path, actuator_id: str, serial_number: str) -> Path:
    """Return where in a folder the history of a unit is."""
    return folder / f"{quote(actuator_id, safe=' ')}+{quote(serial_number, safe=' ')}.sqlite"
