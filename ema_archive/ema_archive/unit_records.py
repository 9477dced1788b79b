"""What an archive knows of its units."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from ema_archive.calibrations import calibration_of, identity_of
from ema_archive.database import Database, transaction
from ema_archive.service_record import ServiceRecord
from ema_archive.settings import ArchiveSettings
from ema_archive.unit_task import UnitResult, made_by


@dataclass(frozen=True)
class UnitEntry:
    """A unit as the manifest knows it."""

    unit: str
    actuator_id: str
    serial_number: str
    model: str
    source: str


@dataclass(frozen=True)
class KnownUnit:
    """A unit with its latest figures.

    Attributes
    ----------
    latest
        Its row of health after its newest test; None before the first run.
    growth
        Its rows of growth.
    record
        What it went through.
    """

    entry: UnitEntry
    latest: dict[str, Any] | None
    growth: list[dict[str, Any]]
    record: ServiceRecord


class UnitRecords(Database):
    """The units of an archive: which are to be followed, and their latest figures."""

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
        with transaction(self._db):
            self._db.execute("UPDATE unit SET is_due = 1 WHERE unit = ?", (entry.unit,))

    def commit_unit(self, entry: UnitEntry, result: UnitResult) -> None:
        """Note health and life of a unit."""
        with transaction(self._db):
            if not self._count("part WHERE unit = ?", (entry.unit,)):
                # All its bags are of others now.
                self._db.execute("DELETE FROM unit WHERE unit = ?", (entry.unit,))
            else:
                self._db.execute(
                    "UPDATE unit SET is_due = 0, made_by = ?, model = ?, latest = ?, growth = ?, "
                    "record = ? "
                    "WHERE unit = ?",
                    (
                        result.made_by,
                        entry.model,
                        json.dumps(result.latest),
                        json.dumps(result.growth),
                        json.dumps(asdict(result.record)),
                        entry.unit,
                    ),
                )

    def units(self) -> Iterator[KnownUnit]:
        """Yield each unit with its latest figures."""
        rows = self._db.execute(
            "SELECT unit, actuator_id, serial_number, model, latest, growth, record FROM unit "
            "ORDER BY unit"
        )
        for *names, latest, growth, record in rows:
            yield KnownUnit(
                UnitEntry(*names, source=""),
                None if latest is None else json.loads(latest),
                json.loads(growth),
                ServiceRecord(**json.loads(record)),
            )
