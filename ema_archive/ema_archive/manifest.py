"""What an archive knows of its bags and units: a database that survives a kill at any moment."""

import fcntl
import json
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ema_archive.bag_task import DAMAGED, FAILED, BagResult
from ema_archive.calibrations import calibration_of, identity_of
from ema_archive.provenance import estimation_software
from ema_archive.settings import ArchiveSettings
from ema_archive.sources import Listed
from ema_archive.unit_task import UnitResult, made_by

FILE: Final = "archive.sqlite"
"""Name of the database in an archive."""

Place = tuple[str, str, str]
"""Model, unit and month of a part of the tables."""

_VERSION: Final = 1
_PAGE: Final = 500
_TABLES: Final = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE bag (
    url TEXT PRIMARY KEY, folder TEXT NOT NULL, size INTEGER NOT NULL, mark TEXT NOT NULL,
    beside TEXT NOT NULL, scan INTEGER NOT NULL, state TEXT NOT NULL DEFAULT 'new',
    seen TEXT NOT NULL DEFAULT '', sha256 TEXT NOT NULL DEFAULT '',
    software TEXT NOT NULL DEFAULT '', settings TEXT NOT NULL DEFAULT '',
    reason TEXT NOT NULL DEFAULT '', remarks TEXT NOT NULL DEFAULT '',
    windows INTEGER NOT NULL DEFAULT 0, valid INTEGER NOT NULL DEFAULT 0
) WITHOUT ROWID;
CREATE TABLE part (
    url TEXT NOT NULL, unit TEXT NOT NULL, model TEXT NOT NULL, source TEXT NOT NULL,
    calibration_id TEXT NOT NULL, months TEXT NOT NULL, last_ns INTEGER NOT NULL,
    PRIMARY KEY (url, unit)
) WITHOUT ROWID;
CREATE TABLE begun (
    url TEXT NOT NULL, model TEXT NOT NULL, unit TEXT NOT NULL, month TEXT NOT NULL,
    PRIMARY KEY (url, model, unit, month)
) WITHOUT ROWID;
CREATE INDEX part_of_unit ON part (unit, last_ns);
CREATE TABLE unit (
    unit TEXT PRIMARY KEY, actuator_id TEXT NOT NULL, serial_number TEXT NOT NULL,
    model TEXT NOT NULL, is_due INTEGER NOT NULL, made_by TEXT NOT NULL DEFAULT '',
    latest TEXT, growth TEXT NOT NULL DEFAULT '[]'
) WITHOUT ROWID;
CREATE TEMP TABLE current (source TEXT, unit TEXT, id TEXT, PRIMARY KEY (source, unit))
    WITHOUT ROWID;
"""
_DUE: Final = """
(state IN ('new', 'failed') OR seen <> mark OR software <> :software OR settings <> :settings
 OR EXISTS (SELECT 1 FROM begun WHERE begun.url = bag.url)
 OR EXISTS (
    SELECT 1 FROM part LEFT JOIN current
    ON current.unit = part.unit
        AND current.source = CASE WHEN :pattern <> '' THEN :pattern ELSE bag.beside END
    WHERE part.url = bag.url AND part.calibration_id IS NOT current.id))
"""


@dataclass(frozen=True)
class UnitEntry:
    """A unit as the manifest knows it."""

    unit: str
    actuator_id: str
    serial_number: str
    model: str
    source: str


@dataclass(frozen=True)
class Status:
    """How an archive stands.

    Attributes
    ----------
    bags, gone, due, damaged, failed
        Bags in all; of these no longer at their place, to be done, that cannot be read, and that
        could not be read the last time.
    reasons
        Why bags are to be done, and how many each.
    units, units_due
        Units, and those whose health and life are to be found anew.
    windows, valid
        Windows, and those with a valid estimate.
    """

    bags: int
    gone: int
    due: int
    damaged: int
    failed: int
    reasons: dict[str, int]
    units: int
    units_due: int
    windows: int
    valid: int


class Manifest(AbstractContextManager["Manifest", None]):
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
        try:
            self._db = sqlite3.connect(path, timeout=30.0, isolation_level=None)
            self._prepare(path)
        except sqlite3.Error as error:
            raise ValueError(f"{path} cannot be used: {error}") from error

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        self._db.close()
        if self._lock is not None:
            self._lock.close()
        if isinstance(error, sqlite3.DatabaseError):
            # Of a read: it is held by another program, or damaged.
            raise OSError(f"{self.archive / FILE} cannot be used: {error}") from error

    def _prepare(self, path: Path) -> None:
        db = self._db
        version = db.execute("PRAGMA user_version").fetchone()[0]
        if version not in (0, _VERSION):
            raise ValueError(f"{path} has version {version}, expected {_VERSION}")
        *tables, current = _TABLES.split(";\n")[:-1]
        if version == 0:
            db.execute("PRAGMA journal_mode = WAL")
            with _transaction(db):
                for statement in tables:
                    db.execute(statement)
                db.execute(f"PRAGMA user_version = {_VERSION}")
        # A kill loses nothing that was committed; a loss of power may lose the last commits, whose
        # bags are then done again.
        db.execute("PRAGMA synchronous = NORMAL")
        db.execute(current)

    @property
    def generation(self) -> int:
        """Number of changes of bags and units so far."""
        return int(self._get("generation", "0"))

    @property
    def settings(self) -> ArchiveSettings:
        """What the archive is computed with.

        Raises
        ------
        ValueError
            When what is kept of them is damaged.
        """
        text = self._get("settings", "")
        if not text:
            return ArchiveSettings()
        try:
            return ArchiveSettings.of_mapping(json.loads(text))
        except (KeyError, TypeError) as error:
            raise ValueError(f"{self.archive / FILE}: the settings are damaged: {error}") from error

    @settings.setter
    def settings(self, settings: ArchiveSettings) -> None:
        with _transaction(self._db):
            self._set("settings", json.dumps(settings.as_mapping()))

    @property
    def sources(self) -> list[str]:
        """Folders and addresses whose bags it has."""
        return json.loads(self._get("sources", "[]"))

    @property
    def next_scan(self) -> int:
        """Number of the scan to come."""
        return int(self._get("scan", "0")) + 1

    def end_scan(self, number: int, sources: Sequence[str]) -> None:
        """Note that all bags of these sources were listed: others are gone."""
        with _transaction(self._db):
            self._set("sources", json.dumps(list(sources)))
            self._set("scan", str(number))
            self._advance()

    def note(self, bags: Iterable[Listed], scan: int) -> None:
        """Note bags as they are listed."""
        with _transaction(self._db):
            self._db.executemany(
                "INSERT INTO bag (url, folder, size, mark, beside, scan) VALUES (?, ?, ?, ?, ?, ?) "
                "ON CONFLICT (url) DO UPDATE SET folder = excluded.folder, size = excluded.size, "
                "mark = excluded.mark, beside = excluded.beside, scan = excluded.scan",
                [(bag.url, bag.folder, bag.size, bag.mark, bag.beside, scan) for bag in bags],
            )

    def find_due(self, settings: ArchiveSettings) -> int:
        """Look at the calibrations as they are now; return how many bags are to be done.

        Raises
        ------
        OSError
            When a calibration cannot be read.
        """
        self._look_at_calibrations(settings)
        return self._count(f"bag WHERE {self._there} AND {_DUE}", self._criteria(settings))

    def due(self, settings: ArchiveSettings) -> Iterator[tuple[str, str, str]]:
        """Yield address, mark and calibration beside of each bag to be done, once each.

        `find_due` comes first. What is committed meanwhile does not matter.
        """
        last = ""
        while True:
            page = self._db.execute(
                f"SELECT url, mark, beside FROM bag WHERE url > :last AND {self._there} AND {_DUE} "
                f"ORDER BY url LIMIT {_PAGE}",
                {**self._criteria(settings), "last": last},
            ).fetchall()
            if not page:
                return
            yield from page
            last = page[-1][0]

    def begin(self, results: Iterable[BagResult]) -> dict[Place, set[str]]:
        """Note where rows of bags are about to be written, and return where they may be already.

        What was begun and not committed, as before a kill, is among them until it is, and due.

        Returns
        -------
        dict
            Bags by the part of the tables in which their rows are to be replaced.
        """
        places: dict[Place, set[str]] = {}
        with _transaction(self._db):
            for one in results:
                url = one.task.url
                new = {
                    (part.model, part.unit, month) for part in one.units for month in part.months
                }
                # Also those of rows that are taken away: until the bag is committed, what was
                # noted of it is not what the tables have.
                every = new | self._places_of(url)
                self._db.executemany(
                    "INSERT OR IGNORE INTO begun VALUES (?, ?, ?, ?)",
                    [(url, *place) for place in every],
                )
                for place in every:
                    places.setdefault(place, set()).add(url)
        return places

    def _places_of(self, url: str) -> set[Place]:
        rows = self._db.execute("SELECT model, unit, months FROM part WHERE url = ?", (url,))
        places = {(model, unit, month) for model, unit, months in rows for month in months.split()}
        begun = self._db.execute("SELECT model, unit, month FROM begun WHERE url = ?", (url,))
        return places | set(begun)

    def commit(self, results: Iterable[BagResult], settings: ArchiveSettings) -> None:
        """Note what became of bags, in one transaction; their units are then due."""
        db = self._db
        with _transaction(db):
            for one in results:
                self._commit_bag(one, settings)
            self._advance()

    def _commit_bag(self, one: BagResult, settings: ArchiveSettings) -> None:
        db, url = self._db, one.task.url
        if one.state == FAILED:
            # What was found of it before still holds.
            db.execute(
                "UPDATE bag SET state = ?, reason = ? WHERE url = ?", (one.state, one.reason, url)
            )
            return
        db.execute(
            "UPDATE unit SET is_due = 1 WHERE unit IN (SELECT unit FROM part WHERE url = ?)", (url,)
        )
        estimates = [row for part in one.units for row in part.estimates]
        db.execute(
            "UPDATE bag SET state = ?, seen = ?, sha256 = ?, software = ?, settings = ?, "
            "reason = ?, remarks = ?, windows = ?, valid = ? WHERE url = ?",
            (
                one.state,
                one.task.mark,
                one.sha256,
                estimation_software(),
                settings.estimation_id,
                one.reason,
                "; ".join(one.remarks),
                len(estimates),
                sum(row["valid"] for row in estimates),
                url,
            ),
        )
        db.execute("DELETE FROM part WHERE url = ?", (url,))
        db.execute("DELETE FROM begun WHERE url = ?", (url,))
        for part in one.units:
            db.execute(
                "INSERT INTO part VALUES (?, ?, ?, ?, ?, ?, ?)",
                (
                    url,
                    part.unit,
                    part.model,
                    one.task.source,
                    part.calibration_id,
                    " ".join(part.months),
                    max(part.stamps_ns, default=0),
                ),
            )
            db.execute(
                "INSERT INTO unit (unit, actuator_id, serial_number, model, is_due) "
                "VALUES (?, ?, ?, ?, 1) ON CONFLICT (unit) DO UPDATE SET is_due = 1",
                (part.unit, part.actuator_id, part.serial_number, part.model),
            )

    def units_due(self, settings: ArchiveSettings) -> list[UnitEntry]:
        """Return the units whose health and life are to be found anew.

        Raises
        ------
        OSError
            When a calibration cannot be read.
        """
        rows = self._db.execute(
            "SELECT unit, actuator_id, serial_number, model, is_due, made_by FROM unit "
            "ORDER BY unit"
        ).fetchall()
        found = []
        for unit, actuator_id, serial_number, model, is_due, maker in rows:
            last = self._db.execute(
                "SELECT part.model, bag.beside FROM part JOIN bag USING (url) WHERE unit = ? "
                "ORDER BY last_ns DESC, url DESC LIMIT 1",
                (unit,),
            ).fetchone()
            model, beside = last or (model, "")
            source = settings.calibration or beside
            calibration_id = identity_of(calibration_of(source, actuator_id, serial_number))
            if is_due or maker != made_by(settings, calibration_id):
                found.append(UnitEntry(unit, actuator_id, serial_number, model, source))
        return found

    def begin_unit(self, entry: UnitEntry) -> None:
        """Note that health and life of a unit are about to be written: it is due until they are."""
        with _transaction(self._db):
            self._db.execute("UPDATE unit SET is_due = 1 WHERE unit = ?", (entry.unit,))

    def commit_unit(self, entry: UnitEntry, result: UnitResult) -> None:
        """Note health and life of a unit."""
        with _transaction(self._db):
            if result.latest is None and not self._count("part WHERE unit = ?", (entry.unit,)):
                # All its bags are of others now.
                self._db.execute("DELETE FROM unit WHERE unit = ?", (entry.unit,))
            else:
                self._db.execute(
                    "UPDATE unit SET is_due = 0, made_by = ?, model = ?, latest = ?, growth = ? "
                    "WHERE unit = ?",
                    (
                        result.made_by,
                        entry.model,
                        None if result.latest is None else json.dumps(result.latest),
                        json.dumps(result.growth),
                        entry.unit,
                    ),
                )
            self._advance()

    def units(self) -> Iterator[tuple[UnitEntry, dict[str, Any] | None, list[dict[str, Any]]]]:
        """Yield each unit with its latest row of health and its rows of growth."""
        rows = self._db.execute(
            "SELECT unit, actuator_id, serial_number, model, latest, growth FROM unit ORDER BY unit"
        )
        for *names, latest, growth in rows:
            known = None if latest is None else json.loads(latest)
            yield UnitEntry(*names, source=""), known, json.loads(growth)

    def bags(self) -> sqlite3.Cursor:
        """Return a row for each bag, with the columns of the table of bags."""
        return self._db.execute(
            f"SELECT url, size, {self._there}, state, sha256, software, settings, reason, remarks, "
            "windows, valid FROM bag ORDER BY url"
        )

    def status(self, settings: ArchiveSettings) -> Status:
        """Return how the archive stands, by the calibrations and the software as they are now.

        Raises
        ------
        OSError
            When a calibration cannot be read.
        """
        due = self.find_due(settings)
        criteria, there = self._criteria(settings), self._there
        # Each bag by the first reason that holds.
        reason = """CASE
            WHEN state = 'new' THEN 'new'
            WHEN state = 'failed' THEN 'could not be read'
            WHEN seen <> mark THEN 'changed'
            WHEN url IN (SELECT url FROM begun) THEN 'interrupted'
            WHEN software <> :software THEN 'other software'
            WHEN settings <> :settings THEN 'other settings'
            ELSE 'other calibration' END"""
        reasons = self._db.execute(
            f"SELECT {reason} AS why, count(*) FROM bag WHERE {there} AND {_DUE} "
            "GROUP BY why ORDER BY why",
            criteria,
        ).fetchall()
        windows, valid = self._db.execute(
            "SELECT coalesce(sum(windows), 0), coalesce(sum(valid), 0) FROM bag"
        ).fetchone()
        return Status(
            self._count("bag"),
            self._count(f"bag WHERE NOT {there}"),
            due,
            self._count("bag WHERE state = ?", (DAMAGED,)),
            self._count("bag WHERE state = ?", (FAILED,)),
            dict(reasons),
            self._count("unit"),
            len(self.units_due(settings)),
            windows,
            valid,
        )

    @property
    def _there(self) -> str:
        return f"(scan >= {int(self._get('scan', '0'))})"

    def _look_at_calibrations(self, settings: ArchiveSettings) -> None:
        pattern = settings.calibration
        rows = self._db.execute(
            "SELECT DISTINCT CASE WHEN ? <> '' THEN ? ELSE bag.beside END, part.unit, "
            "unit.actuator_id, unit.serial_number "
            "FROM part JOIN bag USING (url) JOIN unit ON unit.unit = part.unit",
            (pattern, pattern),
        ).fetchall()
        current = [
            (source, unit, identity_of(calibration_of(source, *names)))
            for source, unit, *names in rows
        ]
        # Of a table that is this connection's alone: no other command has to wait for it.
        with _transaction(self._db, "DEFERRED"):
            self._db.execute("DELETE FROM current")
            self._db.executemany("INSERT INTO current VALUES (?, ?, ?)", current)

    def _criteria(self, settings: ArchiveSettings) -> dict[str, str]:
        return {
            "software": estimation_software(),
            "settings": settings.estimation_id,
            "pattern": settings.calibration,
        }

    def _count(self, what: str, values: Any = ()) -> int:
        return self._db.execute(f"SELECT count(*) FROM {what}", values).fetchone()[0]

    def _get(self, name: str, default: str) -> str:
        row = self._db.execute("SELECT value FROM meta WHERE name = ?", (name,)).fetchone()
        return row[0] if row else default

    def _set(self, name: str, value: str) -> None:
        self._db.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (name, value))

    def _advance(self) -> None:
        self._set("generation", str(self.generation + 1))


class _transaction(AbstractContextManager[None, None]):
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
