"""The task of a unit: from the rows of its estimates and counts to those of health and life."""

from dataclasses import dataclass
from typing import Any, Final

import pyarrow as pa

from ema_archive.calibrations import calibration_of, changed_ns, identity_of
from ema_archive.provenance import prognosis_software
from ema_archive.resuming import KeptState, can_resume, entry_columns, resumed, state_digest
from ema_archive.service_record import ServiceRecord, lives_of, months_of
from ema_archive.settings import ArchiveSettings
from ema_archive.tables import (
    HEALTH,
    count_from,
    estimate_from,
    growth_rows,
    health_row,
)
from ema_core.faults import FAULT_NAMES
from ema_monitor.identification.estimate import DEGRADED, FAILED, REFUSED, VALID
from ema_monitor.model.threads import limit_threads
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import unknown_outlook
from ema_monitor.unit import Unit

_TELLING: Final = (VALID, DEGRADED, FAILED)
_FOUND: Final = ("verdict", "fitness", *FAULT_NAMES)
"""What copies of a test have in common."""


@dataclass(frozen=True)
class UnitTask:
    """What a worker is to do with the tests of a unit.

    Attributes
    ----------
    unit
        Its name, as in paths.
    source
        Where its calibration comes from.
    estimates, usage, health
        Its rows in these tables, in order of time.
    kept
        What an earlier task kept; empty when nothing.
    """

    unit: str
    actuator_id: str
    serial_number: str
    source: str
    settings: ArchiveSettings
    estimates: pa.Table
    usage: pa.Table
    health: pa.Table
    kept: bytes


@dataclass(frozen=True)
class UnitResult:
    """Health and life of a unit.

    Attributes
    ----------
    made_by
        Identity of what they follow from, beside its tests.
    software
        Identity of the software of the worker.
    health
        Rows of the table of health, one a test.
    latest
        Row of health after the newest test, as plain values; its level is STALE without any.
    growth
        Rows of the table of growth.
    record
        What it went through.
    kept
        What a later task goes on from; empty when nothing.
    repeated
        Number of windows that were followed; the others were known.
    """

    unit: str
    made_by: str
    software: str
    health: pa.Table
    latest: dict[str, Any]
    growth: list[dict[str, Any]]
    record: ServiceRecord
    kept: bytes
    repeated: int


def made_by(settings: ArchiveSettings, calibration_id: str) -> str:
    """Return the identity of what health and life follow from, beside the tests of a unit."""
    return f"{prognosis_software()} {settings.prognosis_id} {calibration_id}"


def follow_unit(task: UnitTask) -> UnitResult:
    """Return health and life of a unit after each test, as ``ema prognose`` gives them.

    Where tests are added at the end, those before are not repeated.
    """
    limit_threads(1)
    key = (task.actuator_id, task.serial_number)
    calibration = calibration_of(task.source, *key)
    parameters = None if isinstance(calibration, str) else calibration.unit_parameters
    settings = task.settings.prognosis
    maker = made_by(task.settings, identity_of(calibration))
    estimates, usage = _windows(task.estimates), _counts(task.usage)
    unit, known, rows = _begun(task, maker, estimates, usage)
    shared = {
        "actuator_id": task.actuator_id,
        "serial_number": task.serial_number,
        "software": prognosis_software(),
        "settings": task.settings.prognosis_id,
    }
    later = (estimate_from(row) for row in estimates[known:])
    counts = [count_from(row) for row in usage]
    last = None
    for estimate, outlook in unit.follow(later, parameters, settings, counts):
        if outlook is not None:
            last = outlook
            row = health_row(outlook, estimate.calibration_id) | shared
            if estimate.valid:
                history = unit.history
                found = history.assessments[outlook.stamp_ns]
                row |= entry_columns(history.entries[-1], found)
            rows.append(row)
    if last is None:
        last = unit.resume(parameters, settings) or unknown_outlook("no test so far")
    latest = rows[-1] if rows else health_row(last, "") | shared
    names = {name: shared[name] for name in ("actuator_id", "serial_number")}
    state = b""
    if can_resume(settings) and unit.history.entries:
        digest = state_digest(estimates, usage)
        growth = unit.growth.state()
        state = KeptState(maker, len(estimates), digest, growth).as_bytes()
    return UnitResult(
        task.unit,
        maker,
        prognosis_software(),
        pa.Table.from_pylist(rows, HEALTH),
        latest,
        [row | names for row in growth_rows(last)],
        ServiceRecord(lives_of(rows), months_of(estimates), changed_ns(task.source, *key)),
        state,
        len(estimates) - known,
    )


def _windows(table: pa.Table) -> list[dict[str, Any]]:
    """Return rows of estimates, of a window that is in several bags the first that tells most.

    Two different tests that end at the same time are none: nothing shows which came first.
    """
    found: dict[int, dict[str, Any]] = {}
    for row in table.to_pylist():
        other = found.setdefault(row["end_ns"], row)
        if other is row or row["verdict"] not in _TELLING:
            continue
        if other["verdict"] not in _TELLING:
            found[row["end_ns"]] = row
        elif any(str(row[name]) != str(other[name]) for name in _FOUND):
            reason = (
                f"{other['bag']} and {row['bag']} have different tests that end at the same time: "
                "their stamps must show which came first"
            )
            found[row["end_ns"]] = other | {"valid": False, "verdict": REFUSED, "reason": reason}
    return list(found.values())


def _counts(table: pa.Table) -> list[dict[str, Any]]:
    """Return rows of counts, the same count in several bags once."""
    rows = table.to_pylist()
    return list({(row["stamp_ns"], row["hours"], row["cycles"]): row for row in rows}.values())


def _begun(
    task: UnitTask, maker: str, estimates: list[dict[str, Any]], usage: list[dict[str, Any]]
) -> tuple[Unit, int, list[dict[str, Any]]]:
    """Return the prognosis to go on from, how many windows it knows, and their rows of health."""
    key, settings = (task.actuator_id, task.serial_number), task.settings.prognosis
    kept = KeptState.of_bytes(task.kept) if task.kept else None
    if kept is not None and kept.made_by == maker and kept.tests <= len(estimates):
        before, health = estimates[: kept.tests], task.health.to_pylist()
        if state_digest(before, usage) == kept.digest:
            stamps = {row["end_ns"] for row in before}
            valid = {row["end_ns"] for row in before if row["valid"]}
            # A run that died may have left rows of others beside the state.
            made = (prognosis_software(), task.settings.prognosis_id)
            # As they are made: stamps of a table are dates when they are read.
            rows = [
                row | {"tested": row["stamp_ns"] // 1000}
                for row in health
                if row["stamp_ns"] in stamps and (row["software"], row["settings"]) == made
            ]
            unit = resumed(key, kept, settings, before, rows)
            if unit is not None and valid <= {row["stamp_ns"] for row in rows}:
                return unit, kept.tests, rows
    return Unit(History(*key), settings), 0, []
