"""What an archive knows: its settings and sources, its bags and its units."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

from ema_archive.bag_records import DUE, BagRecords
from ema_archive.bag_task import DAMAGED, FAILED
from ema_archive.database import FILE, transaction
from ema_archive.file_records import FileRecords
from ema_archive.settings import ArchiveSettings
from ema_archive.unit_records import UnitRecords


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
    damaged_files
        Files of its tables that are missing or damaged.
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
    damaged_files: int


class Manifest(BagRecords, UnitRecords, FileRecords):
    """What an archive knows; arguments and errors are those of ``Database``."""

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
        with transaction(self._db):
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
        with transaction(self._db):
            self._set("sources", json.dumps(list(sources)))
            self._set("scan", str(number))

    def status(self, settings: ArchiveSettings) -> Status:
        """Return how the archive stands, by the calibrations and the software as they are now.

        Raises
        ------
        OSError
            When a calibration cannot be read.
        """
        due = self.find_due(settings)
        criteria, there = self._criteria(settings), self.there
        # Each bag by the first reason that holds.
        reason = """CASE
            WHEN state = 'new' THEN 'new'
            WHEN state = 'failed' THEN 'could not be read'
            WHEN state = 'interrupted' THEN 'interrupted'
            WHEN seen <> mark THEN 'changed'
            WHEN software <> :software THEN 'other software'
            WHEN settings <> :settings THEN 'other settings'
            ELSE 'other calibration' END"""
        reasons = self._db.execute(
            f"SELECT {reason} AS why, count(*) FROM bag WHERE {there} AND {DUE} "
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
            len(self.damaged_files()),
        )
