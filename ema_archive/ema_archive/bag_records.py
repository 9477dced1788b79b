"""What an archive knows of its bags."""

import sqlite3
from collections.abc import Iterable, Iterator
from typing import Final

from ema_archive.bag_task import FAILED, BagResult
from ema_archive.calibrations import calibration_of, identity_of
from ema_archive.database import Database, transaction
from ema_archive.provenance import estimation_software
from ema_archive.settings import ArchiveSettings
from ema_archive.sources import Listed

Place = tuple[str, str, str]
"""Model, unit and month of a part of the tables."""

DUE: Final = """
(state IN ('new', 'interrupted', 'failed') OR seen <> mark OR software <> :software
 OR settings <> :settings
 OR EXISTS (
    SELECT 1 FROM part LEFT JOIN current
    ON current.unit = part.unit
        AND current.source = CASE WHEN :pattern <> '' THEN :pattern ELSE bag.beside END
    WHERE part.url = bag.url AND part.calibration_id IS NOT current.id))
"""
"""Condition of bags that are to be done."""

_PAGE: Final = 500


class BagRecords(Database):
    """The bags of an archive: as they are listed, and what became of them."""

    def note(self, bags: Iterable[Listed], scan: int) -> None:
        """Note bags as they are listed."""
        with transaction(self._db):
            self._db.executemany(
                "INSERT INTO bag (url, size, mark, beside, scan) VALUES (?, ?, ?, ?, ?) "
                "ON CONFLICT (url) DO UPDATE SET size = excluded.size, mark = excluded.mark, "
                "beside = excluded.beside, scan = excluded.scan",
                [(bag.url, bag.size, bag.mark, bag.beside, scan) for bag in bags],
            )

    def find_due(self, settings: ArchiveSettings) -> int:
        """Look at the calibrations as they are now; return how many bags are to be done.

        Raises
        ------
        OSError
            When a calibration cannot be read.
        """
        self._look_at_calibrations(settings)
        return self._count(f"bag WHERE {self.there} AND {DUE}", self._criteria(settings))

    def due(self, settings: ArchiveSettings) -> Iterator[tuple[str, str, str]]:
        """Yield address, mark and calibration beside of each bag to be done, once each.

        `find_due` comes first. What is committed meanwhile does not matter.
        """
        last = ""
        while True:
            page = self._db.execute(
                f"SELECT url, mark, beside FROM bag WHERE url > :last AND {self.there} AND {DUE} "
                f"ORDER BY url LIMIT {_PAGE}",
                {**self._criteria(settings), "last": last},
            ).fetchall()
            if not page:
                return
            yield from page
            last = page[-1][0]

    def begin(self, results: Iterable[BagResult]) -> dict[Place, set[str]]:
        """Note where rows of bags are about to be written, and return where they may be already.

        Until the bags are committed they are interrupted, and due.

        Returns
        -------
        dict
            Bags by the part of the tables in which their rows are to be replaced.
        """
        db = self._db
        places: dict[Place, set[str]] = {}
        with transaction(db):
            for one in results:
                url = one.task.url
                months: dict[tuple[str, str], set[str]] = {}
                for part in one.units:
                    months[part.model, part.unit] = set(part.months)
                for model, unit, names in db.execute(
                    "SELECT model, unit, months FROM part WHERE url = ?", (url,)
                ):
                    months.setdefault((model, unit), set()).update(names.split())
                db.execute("UPDATE bag SET state = 'interrupted' WHERE url = ?", (url,))
                for (model, unit), names in months.items():
                    db.execute(
                        "INSERT INTO part VALUES (?, ?, ?, '', '', ?, 0) "
                        "ON CONFLICT (url, unit, model) DO UPDATE SET months = excluded.months",
                        (url, unit, model, " ".join(sorted(names))),
                    )
                    for month in names:
                        places.setdefault((model, unit, month), set()).add(url)
        return places

    def moved(self, results: Iterable[BagResult]) -> list[str]:
        """Return the addresses of bags that are gone and whose content one of the results has."""
        found = set[str]()
        for one in results:
            rows = self._db.execute(
                f"SELECT url FROM bag WHERE sha256 = ? AND url <> ? AND NOT {self.there}",
                (one.sha256, one.task.url),
            )
            found.update(url for (url,) in rows)
        return sorted(found)

    def commit(
        self,
        results: Iterable[BagResult],
        settings: ArchiveSettings,
        moved: Iterable[str] = (),
    ) -> None:
        """Note what became of bags, in one transaction; their units are then due.

        Parameters
        ----------
        moved
            Addresses of bags that are elsewhere now; nothing is known of them any more.
        """
        db = self._db
        with transaction(db):
            for one in results:
                self._commit_bag(one, settings)
            for url in moved:
                self._forget_parts(url)
                db.execute("DELETE FROM bag WHERE url = ?", (url,))

    def _forget_parts(self, url: str) -> None:
        """Forget what a bag has of which unit; these are then due."""
        self._db.execute(
            "UPDATE unit SET is_due = 1 WHERE unit IN (SELECT unit FROM part WHERE url = ?)", (url,)
        )
        self._db.execute("DELETE FROM part WHERE url = ?", (url,))

    def _commit_bag(self, one: BagResult, settings: ArchiveSettings) -> None:
        db, url = self._db, one.task.url
        if one.state == FAILED:
            # What was found of it before still holds.
            db.execute(
                "UPDATE bag SET state = ?, reason = ? WHERE url = ?", (one.state, one.reason, url)
            )
            return
        self._forget_parts(url)
        estimates = [row for part in one.units for row in part.estimates]
        db.execute(
            "UPDATE bag SET state = ?, seen = ?, sha256 = ?, software = ?, settings = ?, "
            "reason = ?, remarks = ?, windows = ?, valid = ? WHERE url = ?",
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
                url,
            ),
        )
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

    def bags(self) -> sqlite3.Cursor:
        """Return a row for each bag, with the columns of the table of bags."""
        return self._db.execute(
            f"SELECT url, size, {self.there}, state, sha256, software, settings, reason, remarks, "
            "windows, valid FROM bag ORDER BY url"
        )

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
        with transaction(self._db, "DEFERRED"):
            self._db.execute("DELETE FROM current")
            self._db.executemany("INSERT INTO current VALUES (?, ?, ?)", current)

    def _criteria(self, settings: ArchiveSettings) -> dict[str, str]:
        return {
            "software": estimation_software(),
            "settings": settings.estimation_id,
            "pattern": settings.calibration,
        }
