"""Tables of the database of a history: tests in a chain of hashes, and what follows from them."""

import hashlib
import json
import sqlite3
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from ema_core.description import UnitKey
from ema_monitor.prognosis.assessment import Assessment, assessment_from, assessment_text
from ema_monitor.prognosis.history_entry import Entry, UnusedCycle, as_text, entry_of

SCHEMA_VERSION: Final = 8
"""``user_version`` of the database."""

_TABLES: Final = (
    "CREATE TABLE IF NOT EXISTS unit (actuator_id TEXT NOT NULL, serial_number TEXT NOT NULL)",
    "CREATE TABLE IF NOT EXISTS test (number INTEGER PRIMARY KEY, record TEXT NOT NULL, "
    "crc32 INTEGER NOT NULL, chain BLOB NOT NULL)",
    "CREATE TABLE IF NOT EXISTS assessment (end_ns INTEGER PRIMARY KEY, record TEXT NOT NULL, "
    "crc32 INTEGER NOT NULL)",
    "CREATE TABLE IF NOT EXISTS head (tests INTEGER NOT NULL, chain BLOB NOT NULL)",
    "CREATE TABLE IF NOT EXISTS growth (tests INTEGER NOT NULL, chain BLOB NOT NULL, "
    "state BLOB NOT NULL, crc32 INTEGER NOT NULL)",
)

Test = Entry | UnusedCycle


class Head(NamedTuple):
    """The end of a chain: how many tests it has, and the hash of the last."""

    tests: int
    chain: bytes


def empty(unit: UnitKey) -> Head:
    """Return the head of a chain without tests."""
    return Head(0, hashlib.sha256(json.dumps(unit).encode()).digest())


def prepare(db: sqlite3.Connection, unit: UnitKey) -> None:
    """Make the tables of a new file."""
    # Also where nothing is to be made: it shows whether the file can be written.
    db.execute("BEGIN IMMEDIATE")
    with db:
        if db.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0]:
            return
        for statement in _TABLES:
            db.execute(statement)
        db.execute("INSERT INTO unit VALUES (?, ?)", unit)
        db.execute("INSERT INTO head VALUES (?, ?)", empty(unit))
        db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")


def check_kind(db: sqlite3.Connection, unit: UnitKey) -> None:
    """Check a file that is not empty before anything of it is changed.

    Raises
    ------
    ValueError
        When it is of another unit or kind.
    """
    if not db.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0]:
        return
    version = db.execute("PRAGMA user_version").fetchone()[0]
    if version != SCHEMA_VERSION:
        raise ValueError(f"its schema version is {version}, expected {SCHEMA_VERSION}")
    units = db.execute("SELECT actuator_id, serial_number FROM unit").fetchall()
    if units != [unit]:
        raise ValueError(f"it is of unit {units}, not {unit}")


def _after(head: Head, record: str) -> Head:
    """Return the head after one more test: its hash covers all before it."""
    return Head(head.tests + 1, hashlib.sha256(head.chain + str(record).encode()).digest())


def insert_tests(db: sqlite3.Connection, head: Head, tests: Sequence[Test]) -> Head:
    """Add tests at the end of the chain in one transaction; return its new head."""
    rows = []
    for text in map(as_text, tests):
        head = _after(head, text)
        rows.append((head.tests, text, zlib.crc32(text.encode()), head.chain))
    db.execute("BEGIN IMMEDIATE")
    with db:
        db.executemany("INSERT INTO test VALUES (?, ?, ?, ?)", rows)
        db.execute("UPDATE head SET tests = ?, chain = ?", head)
    return head


def insert_assessments(db: sqlite3.Connection, assessments: Iterable[Assessment]) -> None:
    """Add or replace assessments in one transaction."""
    texts = [(one.stamp_ns, assessment_text(one)) for one in assessments]
    rows = [(stamp_ns, text, zlib.crc32(text.encode())) for stamp_ns, text in texts]
    db.execute("BEGIN IMMEDIATE")
    with db:
        db.executemany("INSERT OR REPLACE INTO assessment VALUES (?, ?, ?)", rows)


def read_assessments(db: sqlite3.Connection) -> Iterator[Assessment]:
    """Return the assessments in the order of their tests.

    Raises
    ------
    ValueError, KeyError, TypeError
        When one is damaged.
    """
    for record, checksum in db.execute("SELECT record, crc32 FROM assessment ORDER BY end_ns"):
        if not _is_whole(record, checksum):
            raise ValueError("an assessment is damaged: its checksum is wrong")
        yield assessment_from(record)


def read_tests(db: sqlite3.Connection, unit: UnitKey, add: Callable[[Test], None]) -> Head:
    """Read the tests that are intact.

    Where the chain is broken, a test is intact if its checksum is right and it comes later than
    those before it: so one that is there twice or at a wrong place is left out, and what follows
    one that is missing is not lost.

    Parameters
    ----------
    db
        The database.
    unit
        The unit that it is of.
    add
        Called with each intact test.

    Returns
    -------
    Head
        End of the chain.

    Raises
    ------
    ValueError
        After the last test, when not all are there as they were written; the message names the
        places.
    """
    damage: list[str] = []
    head, latest_ns, is_joined = empty(unit), -1, True
    rows = db.execute("SELECT number, record, crc32, chain FROM test ORDER BY number")
    for number, record, checksum, chain in rows:
        is_whole = _is_whole(record, checksum)
        is_linked = _after(head, record).chain == chain
        if number > head.tests + 1:
            damage.append(_missing(head.tests + 1, number - 1))
        elif not is_whole:
            damage.append(f"test {number} is damaged: its checksum is wrong")
        elif not is_linked:
            damage.append(
                f"test {number} does not follow from the one before it in the chain of hashes: "
                "one was deleted, doubled, swapped or changed there"
            )
        head = Head(number, chain if isinstance(chain, bytes) else b"")
        try:
            test = entry_of(record) if is_whole else None
        except (ValueError, KeyError, TypeError) as error:
            damage.append(f"test {number} is damaged: {error}")
            test = None
        is_joined = test is not None and ((is_linked and is_joined) or test.stamp_ns > latest_ns)
        if test is not None and is_joined:
            latest_ns = max(latest_ns, test.stamp_ns)
            add(test)
    written = db.execute("SELECT tests, chain FROM head").fetchall()
    if written and written[0][0] > head.tests:
        damage.append(_missing(head.tests + 1, written[0][0]))
    elif written != [head]:
        damage.append(f"test {head.tests} is not the one that was written last")
    if damage:
        more = f", and {len(damage) - 1} more of the kind" if len(damage) > 1 else ""
        raise ValueError(f"{damage[0]}{more}")
    return head


def _is_whole(record: object, checksum: object) -> bool:
    return zlib.crc32(str(record).encode()) == checksum


def _missing(first: int, last: int) -> str:
    return f"test {first} is missing" if first == last else f"tests {first} to {last} are missing"


def write_growth(db: sqlite3.Connection, head: Head, state: bytes) -> None:
    """Store what is known of growth after the tests up to a head, in one transaction."""
    db.execute("BEGIN IMMEDIATE")
    with db:
        db.execute("DELETE FROM growth")
        db.execute("INSERT INTO growth VALUES (?, ?, ?, ?)", (*head, state, zlib.crc32(state)))


def read_growth(db: sqlite3.Connection) -> bytes:
    """Return what was known of growth after tests that are still the same; empty for nothing."""
    found = db.execute(
        "SELECT state, growth.crc32 FROM growth "
        "JOIN test ON test.number = growth.tests AND test.chain = growth.chain"
    ).fetchone()
    return found[0] if found and zlib.crc32(found[0]) == found[1] else b""
