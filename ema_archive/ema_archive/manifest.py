"""What an archive knows: its settings and sources, its bags, its units and the files of tables."""

import json
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from ema_archive.bag_task import DAMAGED, DONE, FAILED, INCOMPLETE, BagResult, BagTask
from ema_archive.database import FILE, Database
from ema_archive.partitions import STAMPS, month_of, path_of, read_rows
from ema_archive.settings import ArchiveSettings, estimation_software
from ema_archive.sources import Listed, calibration_of, content_digest, identity_of
from ema_archive.unit_task import KeptHistory, UnitEntry, UnitResult, made_by
from ema_core.wording import counted

Place = tuple[str, str, str]
"""Model, unit and month of a part of the tables."""

_THERE: Final = "scan >= (SELECT CAST(value AS INTEGER) FROM meta WHERE name = 'scan')"
"""Condition of bags that the last scan has found."""

_REASON: Final = """
CASE
    WHEN state = 'new' THEN 'new'
    WHEN state = 'failed' THEN 'could not be read'
    WHEN state = 'interrupted' THEN 'interrupted'
    WHEN seen <> mark THEN 'changed'
    WHEN software <> :software THEN 'other software'
    WHEN settings <> :settings THEN 'other settings'
    WHEN state <> 'damaged' AND EXISTS (
        SELECT 1 FROM part WHERE part.url = bag.url
        AND calibration_id <> current_id(iif(:pattern <> '', :pattern, bag.beside), part.unit)
    ) THEN 'other calibration'
END"""
"""Why a bag is to be done, by the first reason that holds; null when it is not."""

_DUE: Final = f"{_THERE} AND {_REASON} IS NOT NULL"
_PAGE: Final = 500


@dataclass(frozen=True)
class Status:
    """How an archive stands.

    Attributes
    ----------
    bags, gone, due, damaged, incomplete, failed
        Bags in all; of these no longer at their place, to be done, that cannot be read, that can be
        read only in part, and that could not be read the last time.
    reasons
        Why bags are to be done, and how many each.
    units, units_due
        Units, and those whose health and life are to be found anew.
    windows, valid, unordered
        Windows; those with a valid estimate that is used; and those whose valid estimate is
        refused, as their stamps do not show which test came first.
    damaged_files
        Files of its tables that are missing or damaged.
    """

    bags: int
    gone: int
    due: int
    damaged: int
    incomplete: int
    failed: int
    reasons: dict[str, int]
    units: int
    units_due: int
    windows: int
    valid: int
    unordered: int
    damaged_files: int


class Manifest(Database):
    """The database of an archive; arguments and errors are as in ``Database``."""

    @property
    def settings(self) -> ArchiveSettings:
        """What the archive is computed with.

        Raises
        ------
        ValueError
            When their stored values are damaged.
        """
        text = self._get("settings")
        try:
            return ArchiveSettings.of_mapping(json.loads(text)) if text else ArchiveSettings()
        except (KeyError, TypeError) as error:
            raise ValueError(f"{self.archive / FILE}: the settings are damaged: {error}") from error

    @settings.setter
    def settings(self, settings: ArchiveSettings) -> None:
        text = json.dumps(settings.as_mapping())
        with self._changing() as db:
            db.execute("UPDATE meta SET value = ? WHERE name = 'settings'", (text,))

    @property
    def sources(self) -> list[str]:
        """Folders and addresses whose bags it has."""
        return json.loads(self._get("sources"))

    @property
    def next_scan(self) -> int:
        """Number of the scan to come."""
        return int(self._get("scan")) + 1

    def note(self, bags: Iterable[Listed], scan: int) -> None:
        """Note bags as they are listed."""
        with self._changing() as db:
            db.executemany(
                "INSERT INTO bag (url, size, mark, beside, scan) VALUES (?, ?, ?, ?, ?) "
                "ON CONFLICT (url) DO UPDATE SET size = excluded.size, mark = excluded.mark, "
                "beside = excluded.beside, scan = excluded.scan",
                [(bag.url, bag.size, bag.mark, bag.beside, scan) for bag in bags],
            )

    def end_scan(self, number: int, sources: Sequence[str]) -> None:
        """Note that all bags of these sources were listed: others are gone."""
        values = [(json.dumps(list(sources)), "sources"), (str(number), "scan")]
        with self._changing() as db:
            db.executemany("UPDATE meta SET value = ? WHERE name = ?", values)

    def status(self, settings: ArchiveSettings) -> Status:
        """Return how the archive stands, by the calibrations and the software as they are now.

        Raises
        ------
        OSError
            When a calibration cannot be read.
        """
        reasons = dict(
            self._rows(
                f"SELECT {_REASON} AS why, count(*) FROM bag WHERE {_DUE} GROUP BY 1 ORDER BY 1",
                self._criteria(settings),
            )
        )
        [(windows, valid)] = self._rows(
            "SELECT coalesce(sum(windows), 0), coalesce(sum(valid), 0) FROM bag"
        )
        unordered = sum(len(summary.get("unordered", ())) for _, _, summary in self.units())
        return Status(
            self._count("bag"),
            self._count(f"bag WHERE NOT {_THERE}"),
            sum(reasons.values()),
            self._count("bag WHERE state = ?", (DAMAGED,)),
            self._count("bag WHERE state = ?", (INCOMPLETE,)),
            self._count("bag WHERE state = ?", (FAILED,)),
            reasons,
            self._count("unit"),
            len(self.units_due(settings)),
            windows,
            valid - unordered,
            unordered,
            len(self._damaged_files()),
        )

    def find_due(self, settings: ArchiveSettings) -> int:
        """Return the number of due bags; errors are as in `status`."""
        return self._count(f"bag WHERE {_DUE}", self._criteria(settings))

    def due(self, settings: ArchiveSettings) -> Iterator[tuple[str, str, str]]:
        """Yield address, mark and calibration beside of each bag to be done, once each.

        What is committed meanwhile does not matter.
        """
        criteria, last = self._criteria(settings), ""
        query = f"SELECT url, mark, beside FROM bag WHERE url > :last AND {_DUE} ORDER BY url"
        while page := self._rows(f"{query} LIMIT {_PAGE}", {**criteria, "last": last}):
            yield from page
            last = page[-1][0]

    def done(self) -> Iterator[tuple[BagTask, str, str]]:
        """Yield the task of each bag that is done, the digest of its content, and the software."""
        settings = self.settings
        query = (
            "SELECT url, mark, beside, sha256, software FROM bag WHERE state IN (?, ?) ORDER BY url"
        )
        for url, mark, beside, sha256, software in self._rows(query, (DONE, INCOMPLETE)):
            yield BagTask(url, mark, beside, settings), sha256, software

    def estimates_of(self, url: str) -> Iterator[dict[str, Any]]:
        """Yield the rows of estimates that the tables have of a bag.

        Raises
        ------
        ValueError
            When a file of the table is damaged.
        """
        query = "SELECT model, unit, months FROM part WHERE url = ? ORDER BY unit, model"
        for model, unit, months in self._rows(query, (url,)):
            for month in months.split():
                path = path_of(self.archive, "estimates", model, unit, month)
                yield from (row for row in read_rows(path, "estimates") if row["bag"] == url)

    def _criteria(self, settings: ArchiveSettings) -> dict[str, str]:
        """Note the present calibrations; return the parameters of the query for due bags."""
        sources = self._rows(
            "SELECT DISTINCT iif(? <> '', ?, beside), unit, actuator_id, serial_number "
            "FROM part JOIN bag USING (url) JOIN unit USING (unit)",
            (settings.calibration, settings.calibration),
        )
        ids = {
            (source, unit): identity_of(calibration_of(source, (actuator_id, serial_number)))
            for source, unit, actuator_id, serial_number in sources
        }
        self._db.create_function("current_id", 2, lambda *of: ids.get(of, ""))
        return {
            "software": estimation_software(),
            "settings": settings.estimation_id,
            "pattern": settings.calibration,
        }

    def begin(self, results: Iterable[BagResult]) -> dict[Place, set[str]]:
        """Note where rows of bags are about to be written, and return where they may be already.

        Until the bags are committed they are interrupted, and due; no file is as it was written.

        Returns
        -------
        dict
            Bags by the part of the tables in which their rows are to be replaced.
        """
        places: dict[Place, set[str]] = {}
        with self._changing() as db:
            for one in results:
                url = one.task.url
                months = {(part.model, part.unit): set[str]() for part in one.units}
                for part in one.units:
                    months[part.model, part.unit] |= set(map(month_of, part.stamps_ns))
                for model, unit, names in self._rows(
                    "SELECT model, unit, months FROM part WHERE url = ?", (url,)
                ):
                    months.setdefault((model, unit), set()).update(names.split())
                db.execute("UPDATE bag SET state = 'interrupted' WHERE url = ?", (url,))
                for (model, unit), names in months.items():
                    db.execute(
                        "INSERT INTO part VALUES (?, ?, ?, ?, '', 0, 0) "
                        "ON CONFLICT (url, unit, model) DO UPDATE SET months = excluded.months",
                        (url, unit, model, " ".join(sorted(names))),
                    )
                    for month in names:
                        places.setdefault((model, unit, month), set()).add(url)
            paths = [(self._name(path),) for place in places for path in self._paths(place)]
            db.executemany("DELETE FROM file WHERE path = ?", paths)
        return places

    def moved(self, results: Iterable[BagResult]) -> list[str]:
        """Return the addresses of bags that are gone and whose content one of the results has."""
        urls = set[str]()
        for one in results:
            query = f"SELECT url FROM bag WHERE sha256 = ? AND url <> ? AND NOT {_THERE}"
            urls.update(url for (url,) in self._rows(query, (one.sha256, one.task.url)))
        return sorted(urls)

    def commit(
        self,
        results: Iterable[BagResult],
        settings: ArchiveSettings,
        moved: Iterable[str] = (),
        places: Iterable[Place] = (),
    ) -> None:
        """Store the results of bags in one transaction; their units are then due.

        Parameters
        ----------
        moved
            Addresses of bags that were moved; their entries are deleted.
        places
            Where their rows were written.
        """
        with self._changing() as db:
            for place in places:
                for path in self._paths(place):
                    self._note_file(path, *place[1:])
            for one in results:
                if one.state == FAILED:
                    # Its earlier results remain valid.
                    values = (one.state, one.reason, one.task.url)
                    db.execute("UPDATE bag SET state = ?, reason = ? WHERE url = ?", values)
                elif one.state == DAMAGED:
                    self._commit_damaged(one, settings)
                else:
                    self._commit_bag(one, settings)
            for url in moved:
                self._forget_parts(url)
                db.execute("DELETE FROM bag WHERE url = ?", (url,))

    def _commit_damaged(self, one: BagResult, settings: ArchiveSettings) -> None:
        """Note a bag that cannot be read; its earlier results are kept."""
        self._db.execute(
            "UPDATE bag SET state = ?, reason = ?, seen = ?, software = ?, settings = ? "
            "WHERE url = ?",
            (
                one.state,
                one.reason,
                one.task.mark,
                one.software,
                settings.estimation_id,
                one.task.url,
            ),
        )
        units = "(SELECT unit FROM part WHERE url = ?)"
        self._db.execute(f"UPDATE unit SET is_due = 1 WHERE unit IN {units}", (one.task.url,))

    def _commit_bag(self, one: BagResult, settings: ArchiveSettings) -> None:
        db, url = self._db, one.task.url
        self._forget_parts(url)
        estimates = [row for part in one.units for row in part.estimates]
        db.execute(
            "UPDATE bag SET state = ?, seen = ?, sha256 = ?, software = ?, settings = ?, "
            "reason = ?, remarks = ?, windows = ?, valid = ?, end_ns = ? WHERE url = ?",
            (
                one.state,
                one.task.mark,
                one.sha256,
                one.software,
                settings.estimation_id,
                one.reason,
                "; ".join(one.remarks),
                len(estimates),
                sum(row["valid"] for row in estimates),
                one.end_ns,
                url,
            ),
        )
        for part in one.units:
            stamps_ns = part.stamps_ns
            months = " ".join(sorted(set(map(month_of, stamps_ns))))
            last_ns = max(stamps_ns, default=0)
            db.execute(
                "INSERT INTO part VALUES (?, ?, ?, ?, ?, ?, ?)",
                (
                    url,
                    part.unit,
                    part.model,
                    months,
                    part.calibration_id,
                    last_ns,
                    len(part.estimates),
                ),
            )
            db.execute(
                "INSERT INTO unit (unit, actuator_id, serial_number, model, is_due) "
                "VALUES (?, ?, ?, ?, 1) ON CONFLICT (unit) DO UPDATE SET is_due = 1",
                (part.unit, part.actuator_id, part.serial_number, part.model),
            )

    def _forget_parts(self, url: str) -> None:
        """Delete the units' parts of a bag; the units are then due."""
        units = "(SELECT unit FROM part WHERE url = ?)"
        self._db.execute(f"UPDATE unit SET is_due = 1 WHERE unit IN {units}", (url,))
        self._db.execute("DELETE FROM part WHERE url = ?", (url,))

    def units_due(self, settings: ArchiveSettings) -> list[UnitEntry]:
        """Return the units with outdated health and life; errors are as in `status`."""
        rows = self._rows(
            # Model and calibration of each unit come from its latest bag.
            "SELECT unit.unit, actuator_id, serial_number, coalesce(part.model, unit.model), "
            "coalesce(beside, ''), is_due, made_by FROM unit LEFT JOIN part "
            "ON part.unit = unit.unit AND (part.url, part.model) = (SELECT url, model FROM part "
            "AS latest WHERE latest.unit = unit.unit ORDER BY last_ns DESC, url DESC LIMIT 1) "
            "LEFT JOIN bag USING (url) ORDER BY unit.unit"
        )
        entries = []
        for unit, actuator_id, serial_number, model, beside, is_due, maker in rows:
            source = settings.calibration or beside
            calibration = calibration_of(source, (actuator_id, serial_number))
            if is_due or maker != made_by(settings, identity_of(calibration)):
                entries.append(UnitEntry(unit, actuator_id, serial_number, model, source))
        return entries

    def lost_after(self, unit: str) -> str:
        """Return why the newest test of a unit may be lost; "" where it is not.

        It may be lost with a damaged bag, unless a later bag that is whole has a test.
        """
        rows = self._rows(
            "SELECT url, state, reason FROM part JOIN bag USING (url) "
            "WHERE unit = :unit AND state IN (:damaged, :incomplete) AND NOT EXISTS ("
            "SELECT 1 FROM part AS later JOIN bag AS whole USING (url) WHERE later.unit = :unit "
            "AND later.windows AND whole.state = :done AND whole.end_ns > bag.end_ns) "
            "ORDER BY bag.end_ns DESC, url LIMIT 1",
            {"unit": unit, "damaged": DAMAGED, "incomplete": INCOMPLETE, "done": DONE},
        )
        return next((f"later tests may be lost: {_named(*row)}" for row in rows), "")

    def kept_history(self, unit: str) -> KeptHistory | None:
        """Return the history of a unit that its next tests are added to; None without any."""
        query = "SELECT made_by, tests, digest, history FROM kept WHERE unit = ?"
        return next((KeptHistory(*row) for row in self._rows(query, (unit,))), None)

    def begin_unit(self, unit: str) -> None:
        """Note that health and life of a unit are about to be written: it is due until they are."""
        with self._changing():
            self._forget_health(unit)

    def commit_unit(self, entry: UnitEntry, result: UnitResult) -> None:
        """Note health and life of a unit."""
        with self._changing() as db:
            self._note_file(path_of(self.archive, "health", entry.model, entry.unit), entry.unit)
            if kept := result.kept:
                values = (entry.unit, kept.made_by, kept.tests, kept.digest, kept.content)
                db.execute("INSERT INTO kept VALUES (?, ?, ?, ?, ?)", values)
            db.execute(
                "UPDATE unit SET is_due = 0, made_by = ?, model = ?, summary = ? WHERE unit = ?",
                (result.made_by, entry.model, json.dumps(result.summary), entry.unit),
            )
            # A unit whose bags all belong to other units is unknown.
            db.execute("DELETE FROM unit WHERE unit NOT IN (SELECT unit FROM part)")

    def _forget_health(self, unit: str) -> None:
        for change in (
            "UPDATE unit SET is_due = 1 WHERE unit = ?",
            "DELETE FROM kept WHERE unit = ?",
            "DELETE FROM file WHERE unit = ? AND month = ''",
        ):
            self._db.execute(change, (unit,))

    def units(self) -> Iterator[tuple[str, str, dict[str, list[dict[str, Any]]]]]:
        """Yield model and name of each unit, and its rows in the tables that are one file each."""
        rows = self._db.execute("SELECT model, unit, summary FROM unit ORDER BY unit")
        for model, unit, summary in rows:
            yield model, unit, json.loads(summary)

    def bags(self) -> sqlite3.Cursor:
        """Return a row for each bag, with the columns of the table of bags."""
        return self._db.execute(
            f"SELECT url, size, {_THERE}, state, sha256, software, settings, reason, remarks, "
            "windows, valid FROM bag ORDER BY url"
        )

    def _paths(self, place: Place) -> list[Path]:
        return [path_of(self.archive, table, *place) for table in STAMPS]

    def _name(self, path: Path) -> str:
        return str(path.relative_to(self.archive))

    def note_table(self, path: Path) -> None:
        """Note a table that is one file as it was just written."""
        with self._changing():
            self._note_file(path, "")

    def _note_file(self, path: Path, unit: str, month: str = "") -> None:
        """Note a file as it was just written; one that is not there would have no rows."""
        if path.exists():
            stat = path.stat()
            noted = (stat.st_size, stat.st_mtime_ns, content_digest(path))
            values = (self._name(path), unit, month, *noted)
            self._db.execute("INSERT OR REPLACE INTO file VALUES (?, ?, ?, ?, ?, ?)", values)

    def mend(self) -> list[str]:
        """Mark damaged files for recomputation; return one message per finding."""
        damaged = self._damaged_files()
        if not damaged:
            return []
        due = set[str]()
        with self._changing() as db:
            for path, unit, month in damaged:
                path.unlink(missing_ok=True)
                self._forget_health(unit)
                if month:
                    query = "SELECT url FROM part WHERE unit = ? AND instr(months, ?)"
                    due.update(url for (url,) in self._rows(query, (unit, month)))
                    db.execute("DELETE FROM file WHERE path = ?", (self._name(path),))
            urls = [(url,) for url in sorted(due)]
            db.executemany("UPDATE bag SET state = 'interrupted' WHERE url = ?", urls)
        words = [f"{counted(len(damaged), 'file')} of the tables missing or damaged: made anew"]
        gone = [one[0] for one in urls if self._count(f"bag WHERE url = ? AND NOT {_THERE}", one)]
        if gone:
            words.append(
                f"{counted(len(gone), 'bag')} of these tables are missing, such as {gone[0]}: "
                "bring them back and scan, or their windows are lost"
            )
        return words


def _named(url: str, state: str, reason: str) -> str:
    if url in reason:
        return reason
    what = "cannot be read" if state == DAMAGED else "can be read only in part"
    return f"{url} {what}: {reason}"
