# SPDX-License-Identifier: Apache-2.0
"""Manifest of an archive: its settings, sources, bags and units, and the work that is due."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import duckdb
import pyarrow as pa

from ema_archive.bag_task import DONE, INCOMPLETE, BagTask
from ema_archive.history_rows import HISTORY_TABLES, KeptHistory
from ema_archive.losses import losses_by_unit, unread_of_no_unit
from ema_archive.settings import ArchiveSettings, estimation_software
from ema_archive.sources import Listed, calibration_of, identity_of
from ema_archive.store import Store
from ema_archive.tables import BAG_TABLES
from ema_archive.unit_task import UnitEntry, UnitTask, made_by

Criteria = tuple[dict[str, str], pa.Table]
"""Query parameters for due bags, and table of the current calibrations: source, unit, identity."""

_DUE: Final = """
WITH recalibrated AS (
    SELECT DISTINCT bag FROM manifest.part JOIN manifest.bag USING (bag) JOIN _current
    ON _current.unit = part.unit
    AND source = CASE WHEN $pattern <> '' THEN $pattern ELSE calibration_url END
    WHERE part.calibration_id <> _current.calibration_id
),
reasons AS (
    SELECT bag, mark, calibration_url, CASE
        WHEN state = 'new' THEN 'new'
        WHEN state = 'failed' THEN 'could not be read'
        WHEN state = 'lost' THEN 'rows lost'
        WHEN seen <> mark THEN 'changed'
        WHEN software <> $software THEN 'other software'
        WHEN settings <> $settings THEN 'other settings'
        WHEN state <> 'damaged' AND recalibrated.bag IS NOT NULL THEN 'other calibration'
    END AS why
    FROM manifest.bag LEFT JOIN recalibrated USING (bag) WHERE is_there
)
SELECT {} FROM reasons WHERE why IS NOT NULL {}
"""
"""Query for due bags, each with the first applicable reason."""

_PAGE: Final = 20_000


@dataclass(frozen=True)
class Status:
    """Status of an archive."""

    bags: int
    """Number of bags."""
    gone: int
    """Number of missing bags."""
    due: int
    """Number of bags to process."""
    damaged: int
    """Number of existing bags that are unreadable."""
    incomplete: int
    """Number of existing bags that are incomplete."""
    failed: int
    """Number of existing bags that are temporarily unreadable."""
    reasons: dict[str, int]
    """Number of due bags, keyed by reason."""
    units: int
    """Number of units."""
    units_due: int
    """Number of units with outdated health and life."""
    windows: int
    """Number of windows."""
    valid: int
    """Number of windows with a valid and used estimate."""
    unordered: int
    """Number of windows whose valid estimate is refused because the order of tests is unknown."""
    damaged_tables: list[str]
    """Tables with unreadable rows."""
    of_no_unit: list[str]
    """Unread bags that cannot be assigned to a unit."""


class Manifest(Store):
    """Manifest of an archive. Arguments and errors are as in ``Store``."""

    @property
    def settings(self) -> ArchiveSettings:
        """Settings with which the archive is computed.

        Raises
        ------
        ValueError
            If the stored values are damaged.
        """
        [(text,)] = self._rows("SELECT settings FROM manifest.archive")
        try:
            return ArchiveSettings.of_mapping(json.loads(text)) if text else ArchiveSettings()
        except (KeyError, TypeError) as error:
            raise ValueError(f"{self.path}: the settings are damaged: {error}") from error

    @settings.setter
    def settings(self, settings: ArchiveSettings) -> None:
        text = json.dumps(settings.as_mapping())
        if self._rows("SELECT settings FROM manifest.archive") != [(text,)]:
            with self.changing() as db:
                db.execute("UPDATE manifest.archive SET settings = ?", [text])

    @property
    def sources(self) -> list[str]:
        """Folders, and addresses in object stores, that are scanned for bags."""
        [(sources,)] = self._rows("SELECT sources FROM manifest.archive")
        return sources

    @property
    def next_scan(self) -> int:
        """Number of the next scan."""
        [(number,)] = self._rows("SELECT scan + 1 FROM manifest.archive")
        return number

    def note(self, bags: Iterable[Listed], scan: int) -> None:
        """Record bags listed in the scan with the number ``scan``."""
        with self.changing() as db:
            _note_bags(db, bags, scan)

    def end_scan(self, number: int, sources: Sequence[str], bags: Iterable[Listed] = ()) -> None:
        """Record the last bags and end a scan. Bags that were not listed in it become missing."""
        with self.changing() as db:
            _note_bags(db, bags, number)
            db.execute("UPDATE manifest.archive SET sources = ?, scan = ?", [sources, number])
            gone = "is_there AND scan < ?"
            db.execute(f"UPDATE manifest.bag SET is_there = false WHERE {gone}", [number])

    def status(self, settings: ArchiveSettings) -> Status:
        """Return the status of the archive relative to the current calibrations and software.

        Raises
        ------
        OSError
            If the store or a calibration cannot be read.
        """
        with self.reading():
            damaged = self.damaged_tables()
            criteria = self.criteria(settings)
            reasons = dict(self._due("why, count(*)", "GROUP BY why ORDER BY why", criteria))
            [(bags, gone, unread, incomplete, failed, windows, valid)] = self._rows(
                "SELECT count(*), count(*) FILTER (NOT is_there), "
                "count(*) FILTER (state = 'damaged' AND is_there), "
                "count(*) FILTER (state = 'incomplete' AND is_there), "
                "count(*) FILTER (state = 'failed' AND is_there), coalesce(sum(windows), 0), "
                "coalesce(sum(valid), 0) FROM manifest.bag"
            )
            [(units,)] = self._rows("SELECT count(*) FROM manifest.unit")
            unordered = 0
            if "unordered" not in damaged:
                [(unordered,)] = self._rows("SELECT count(*) FROM unordered")
            return Status(
                bags,
                gone,
                sum(reasons.values()),
                unread,
                incomplete,
                failed,
                reasons,
                units,
                len(self.units_due(settings)),
                windows,
                valid - unordered,
                unordered,
                damaged,
                unread_of_no_unit(self),
            )

    def criteria(self, settings: ArchiveSettings) -> Criteria:
        """Return the query parameters for due bags, and the current calibrations.

        Raises
        ------
        OSError
            If a calibration cannot be read.
        """
        pattern = settings.calibration
        sources = self._rows(
            "SELECT DISTINCT CASE WHEN $1 <> '' THEN $1 ELSE calibration_url END, unit.unit, "
            "actuator_id, serial_number FROM manifest.part JOIN manifest.bag USING (bag) "
            "JOIN manifest.unit USING (unit)",
            [pattern],
        )
        rows = [
            (source, unit, identity_of(calibration_of(source, (actuator_id, serial_number))))
            for source, unit, actuator_id, serial_number in sources
        ]
        names = ("source", "unit", "calibration_id")
        schema = pa.schema([(name, pa.string()) for name in names])
        current = pa.Table.from_pylist([dict(zip(names, row, strict=True)) for row in rows], schema)
        software = estimation_software()
        values = {"software": software, "settings": settings.estimation_id, "pattern": pattern}
        return values, current

    def _due(self, columns: str, rest: str, criteria: Criteria, **more: str) -> list[Any]:
        values, current = criteria
        with self.reading() as db:
            db.register("_current", current)
            rows = db.execute(_DUE.format(columns, rest), {**values, **more}).fetchall()
            db.unregister("_current")
        return rows

    def find_due(self, settings: ArchiveSettings) -> int:
        """Return the number of due bags; errors are as in `status`."""
        with self.reading():
            [(number,)] = self._due("count(*)", "", self.criteria(settings))
        return number

    def due(self, settings: ArchiveSettings) -> Iterator[tuple[str, str, str]]:
        """Yield address, change mark, and calibration address of each due bag.

        Commits during the iteration do not affect it.
        """
        criteria, last = self.criteria(settings), ""
        rest = f"AND bag > $last ORDER BY bag LIMIT {_PAGE}"
        while page := self._due("bag, mark, calibration_url", rest, criteria, last=last):
            yield from page
            last = page[-1][0]

    def done(self) -> Iterator[tuple[BagTask, str, str]]:
        """Yield task, content digest and software of each processed bag."""
        settings, last = self.settings, ""
        query = (
            "SELECT bag, mark, calibration_url, bag_sha256, software FROM manifest.bag "
            f"WHERE state IN (?, ?) AND bag > ? ORDER BY bag LIMIT {_PAGE}"
        )
        while page := self._rows(query, [DONE, INCOMPLETE, last]):
            for url, mark, calibration, sha256, software in page:
                yield BagTask(url, mark, calibration, settings), sha256, software
            last = page[-1][0]

    def estimates_of(self, url: str) -> list[dict[str, Any]]:
        """Return the estimate rows of a bag.

        Raises
        ------
        OSError
            If the table is damaged.
        """
        query = "SELECT * FROM estimates WHERE bag = ? ORDER BY unit, model, end_ns, number"
        with self.reading() as db:
            rows = db.execute(query, [url]).to_arrow_table()
        return rows.select(BAG_TABLES["estimates"].names).cast(BAG_TABLES["estimates"]).to_pylist()

    def units_due(self, settings: ArchiveSettings) -> list[UnitEntry]:
        """Return the units with outdated health and life; errors are as in `status`."""
        losses = losses_by_unit(self)
        rows = self._rows(
            # Model and calibration of each unit are from its latest bag.
            "WITH latest AS (SELECT unit, model, bag FROM manifest.part QUALIFY row_number() OVER "
            "(PARTITION BY unit ORDER BY last_ns DESC, bag DESC, model) = 1) "
            "SELECT unit.unit, actuator_id, serial_number, coalesce(latest.model, unit.model), "
            "coalesce(calibration_url, ''), is_due, made_by, lost FROM manifest.unit "
            "LEFT JOIN latest USING (unit) LEFT JOIN manifest.bag USING (bag) ORDER BY unit.unit"
        )
        entries = []
        for unit, actuator_id, serial_number, model, url, is_due, maker, before in rows:
            source = settings.calibration or url
            calibration = calibration_of(source, (actuator_id, serial_number))
            lost, made = losses.get(unit, ""), made_by(settings, identity_of(calibration))
            if is_due or (maker, before) != (made, lost):
                entries.append(UnitEntry(unit, actuator_id, serial_number, model, source, lost))
        return entries

    def unit_task(self, entry: UnitEntry, settings: ArchiveSettings) -> UnitTask:
        """Return the task of a unit, with its rows.

        Raises
        ------
        ValueError, OSError
            As in ``Store.reading``.
        """
        unit = entry.unit
        with self.reading():
            return UnitTask(
                entry,
                settings,
                **{name: self.rows_of_unit(name, unit) for name in (*BAG_TABLES, "health")},
                kept=self._kept_history(unit),
            )

    def _kept_history(self, unit: str) -> KeptHistory | None:
        """Return the stored history of a unit, which new tests extend; None if there is none."""
        rows = self._rows(
            "SELECT made_by, digest, windows FROM manifest.unit WHERE unit = ? AND windows > 0",
            [unit],
        )
        for maker, digest, windows in rows:
            tables = {name: self.rows_of_unit(name, unit) for name in HISTORY_TABLES}
            return KeptHistory(maker, digest, windows, tables)
        return None

    def _rows(self, query: str, values: Any = None) -> list[Any]:
        with self.reading() as db:
            return db.execute(query, values).fetchall()


def _note_bags(db: duckdb.DuckDBPyConnection, bags: Iterable[Listed], scan: int) -> None:
    rows = [
        {
            "bag": bag.url,
            "bytes": bag.size,
            "mark": bag.mark,
            "calibration_url": bag.calibration_url,
        }
        | {"scan": scan, "is_there": True}
        for bag in bags
    ]
    if not rows:
        return
    changes = ", ".join(f"{name} = _rows.{name}" for name in rows[0] if name != "bag")
    db.register("_rows", pa.Table.from_pylist(rows))
    db.execute(
        f"MERGE INTO manifest.bag USING _rows USING (bag) WHEN MATCHED THEN UPDATE SET {changes} "
        "WHEN NOT MATCHED THEN INSERT BY NAME"
    )
    db.unregister("_rows")
