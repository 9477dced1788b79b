# SPDX-License-Identifier: Apache-2.0
"""Unit task: computation of health and life of a unit from its estimates, counts and duty."""

import hashlib
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

import pyarrow as pa

from ema_archive.history_rows import KeptHistory, history_from, kept_history
from ema_archive.settings import ArchiveSettings, prognosis_software
from ema_archive.sources import calibration_of, changed_ns, identity_of
from ema_archive.tables import (
    UNIT_TABLES,
    duty_from,
    estimate_from,
    growth_rows,
    health_row,
    reason_rows,
)
from ema_core.description import UnitKey
from ema_core.event_kinds import EventKind
from ema_core.faults import FAULT_NAMES
from ema_core.levels import ERROR, OK, STALE
from ema_monitor.identification.estimate import Verdict
from ema_monitor.model.threads import limit_threads
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Count, StampedTest, unordered
from ema_monitor.prognosis.outlook import unknown_outlook
from ema_monitor.reason_texts import text_of
from ema_monitor.reasons import Reason
from ema_monitor.reports import health_report
from ema_monitor.unit import Unit

Row = Mapping[str, Any]

_SAME: Final = ("end_ns", "verdict", "fitness", *FAULT_NAMES)
"""Columns that are equal in all copies of a test."""

_DUTY: Final = ("stamp_ns", "hours", "travel", "travel_load", "winding_hours", "winding_rise_hours")
_MADE_BY: Final = ("software", "settings")
_IDENTITY: Final = ("end_ns", "verdict", "bag_sha256", "number", "calibration_id", *_MADE_BY)


@dataclass(frozen=True)
class UnitEntry:
    """A unit of an archive, the source of its calibration, and why later tests may be lost.

    ``source`` is as in `ema_archive.sources.calibration_of`; ``lost`` is "" if no later test can be
    lost.
    """

    unit: str
    actuator_id: str
    serial_number: str
    model: str
    source: str
    lost: str = ""

    @property
    def key(self) -> UnitKey:
        """Actuator id and serial number."""
        return self.actuator_id, self.serial_number


@dataclass(frozen=True)
class UnitTask:
    """Task of a worker: the rows of a unit in each table, in chronological order.

    ``kept`` is the history stored by an earlier task. If it is None, processing starts from the
    first test.
    """

    entry: UnitEntry
    settings: ArchiveSettings
    estimates: pa.Table
    usage: pa.Table
    duty: pa.Table
    health: pa.Table
    kept: KeptHistory | None


@dataclass(frozen=True)
class UnitResult:
    """Health and life of a unit."""

    made_by: str
    """Identity of the inputs, from the function `made_by`."""
    software: str
    """Digest of the source code of the worker."""
    tables: dict[str, pa.Table]
    """Rows, keyed by the names in ``UNIT_TABLES``."""
    kept: KeptHistory | None
    """History for the next task; None if it cannot be extended."""
    followed: int
    """Number of newly processed windows."""


def made_by(settings: ArchiveSettings, calibration_id: str) -> str:
    """Return the identity of all inputs to health and life, except the tests of the unit."""
    return f"{prognosis_software()} {settings.prognosis_id} {calibration_id}"


def follow_unit(task: UnitTask) -> UnitResult:
    """Compute health and life of a unit after each test, as ``ema predict`` prints them.

    If tests were only appended, earlier tests are not recomputed.
    """
    limit_threads(1)
    entry, settings = task.entry, task.settings.prognosis
    calibration = calibration_of(entry.source, entry.key)
    parameters = None if isinstance(calibration, Reason) else calibration.unit_parameters
    names = {"actuator_id": entry.actuator_id, "serial_number": entry.serial_number}
    shared = names | {"software": prognosis_software(), "settings": task.settings.prognosis_id}
    maker = made_by(task.settings, identity_of(calibration))
    estimates, refused = _windows(task.estimates)
    # A count repeated in several bags counts once.
    columns = (task.usage[name].to_pylist() for name in ("stamp_ns", "hours", "cycles"))
    usage = [Count(*values) for values in dict.fromkeys(zip(*columns, strict=True))]
    duty = _pieces(task.duty)
    processed, history = _history_of(task, maker, estimates, usage, duty)
    # Timestamp columns are read as dates: convert them back to integers.
    before = task.health.to_pylist() if processed else []
    rows = [row | {"tested": row["tested_ns"] // 1000} for row in before]
    unit, last = Unit(history, settings), None
    later = (estimate_from(row) for row in estimates[processed:])
    processed_ns = estimates[processed - 1]["end_ns"] if processed else None
    flown = [
        (row["stamp_ns"], duty_from(row))
        for row in duty
        if processed_ns is None or row["stamp_ns"] > processed_ns
    ]
    for estimate, outlook in unit.follow(later, parameters, settings, usage, flown):
        if outlook is not None:
            last = outlook
            report = health_report(outlook, entry.key)
            rows.append(health_row(report, estimate.calibration_id) | shared)
    if last is None:
        last = unit.resume(parameters, settings) or unknown_outlook("no test so far")
    kept = None
    # If hours per cycle replace counts, an event reports this once, at the first count.
    if settings.service.hours_per_cycle == 0.0 and history.entries:
        digest = _digest_of(estimates, usage, duty)
        kept = kept_history(history, unit.growth.state(), maker, digest, len(estimates))
    # Months in which the unit was tested.
    windows = Counter(month_of(row["end_ns"]) for row in estimates)
    valid = Counter(month_of(row["end_ns"]) for row in estimates if row["valid"])
    changed = changed_ns(entry.source, entry.key)
    report = health_report(last, entry.key)
    latest = rows[-1] if rows else health_row(report, "") | shared
    if entry.lost:
        latest = _unconfirmed(latest, entry.lost)
    months = [
        {"month": month, "windows": windows[month], "valid": valid[month]}
        for month in sorted(windows)
    ]
    tables: dict[str, list[dict[str, Any]]] = {
        "health": rows,
        "units": [{**latest, "calibrated": None if changed is None else changed // 1000}],
        "growth": [row | names for row in growth_rows(report)],
        "lives": lives_of(rows),
        "months": months,
        "unordered": refused,
    }
    return UnitResult(
        maker,
        prognosis_software(),
        {name: pa.Table.from_pylist(of, UNIT_TABLES[name]) for name, of in tables.items()},
        kept,
        len(estimates) - processed,
    )


def _unconfirmed(row: Row, lost: str) -> Row:
    """Return a health row that allows for lost tests: alarms remain, OK becomes STALE."""
    doubt = {"reason": "; ".join(filter(None, [lost, row["reason"]]))}
    if row["level"] != OK:
        return {**row, **doubt}
    return {**row, **doubt, "level": STALE, "last_level": OK, "confidence": 0.0}


def _history_of(
    task: UnitTask,
    maker: str,
    estimates: Sequence[Row],
    usage: Sequence[Count],
    duty: Sequence[Row],
) -> tuple[int, History]:
    """Return the number of windows already processed, and the history after them."""
    key, kept = task.entry.key, task.kept
    if kept is not None and kept.made_by == maker:
        windows = estimates[: kept.windows]
        if _digest_of(windows, usage, duty) == kept.digest:
            return kept.windows, history_from(kept, key, windows)
    return 0, History(*key)


def month_of(stamp_ns: int) -> str:
    """Return the UTC month of a timestamp [ns], such as "2031-05"."""
    return datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC).strftime("%Y-%m")


def _pieces(table: pa.Table) -> list[Row]:
    """Return duty rows in chronological order, without duplicates.

    A window may be in several bags that started at different times. If several bags have rows with
    the same timestamp, only the rows of the bag with the most telemetry are returned.
    """
    by_stamp: dict[int, dict[str, list[Row]]] = {}
    for row in table.to_pylist():
        by_stamp.setdefault(row["stamp_ns"], {}).setdefault(row["bag"], []).append(row)
    most = (max(of_bags.values(), key=_telemetry_hours) for of_bags in by_stamp.values())
    return [row for rows in most for row in rows]


def _telemetry_hours(rows: Sequence[Row]) -> float:
    return sum(row["hours"] for row in rows)


def _digest_of(estimates: Sequence[Row], usage: Sequence[Count], duty: Sequence[Row]) -> str:
    """Return a digest of windows, and of counts and duty up to the last window."""
    last_ns = estimates[-1]["end_ns"] if estimates else 0
    windows = [[row[name] for name in _IDENTITY] for row in estimates]
    counts = [count for count in usage if count.stamp_ns <= last_ns]
    flown = [[row[name] for name in _DUTY] for row in duty if row["stamp_ns"] <= last_ns]
    return hashlib.sha256(repr((windows, counts, flown)).encode()).hexdigest()


def _windows(table: pa.Table) -> tuple[list[Row], list[dict[str, Any]]]:
    """Return the estimate rows without duplicates, and the rows of the table ``unordered``.

    The first result has the most informative copy of each window. Valid tests whose order is
    unknown are refused and listed in the second result; failures and departures are kept.
    """
    windows_by_end: dict[int, Row] = {}
    rows = table.to_pylist()
    for row in rows:
        best = windows_by_end.setdefault(row["end_ns"], row)
        if _informativeness(row) > _informativeness(best):
            windows_by_end[row["end_ns"]] = row
    reasons = unordered(
        StampedTest(
            row["start_ns"],
            row["end_ns"],
            row["bag"],
            [str(row[name]) for name in _SAME],
            not (row["valid"] or row["verdict"] == Verdict.FAILED),
        )
        for row in sorted(rows, key=lambda row: (row["bag"], row["number"]))
        if row["verdict"] != Verdict.SKIPPED
    )
    refused = [
        {"bag": row["bag"], "number": row["number"]}
        | {"tested": row["end_ns"] // 1000, "reason": text_of(reasons[first])}
        for row in rows
        if row["valid"] and (first := windows_by_end[row["end_ns"]]["bag"]) in reasons
    ]
    windows = []
    for row in windows_by_end.values():
        if row["valid"] and row["bag"] in reasons:
            why = {"verdict": Verdict.REFUSED, "reasons": reason_rows([reasons[row["bag"]]])}
            row = {**row, "valid": False} | (why if row["verdict"] != Verdict.DEPARTED else {})
        windows.append(row)
    return windows, refused


def _informativeness(row: Row) -> int:
    """Return the rank of a copy of a window: failures are highest, refused windows lowest."""
    return {Verdict.FAILED: 3, Verdict.DEPARTED: 1}.get(row["verdict"], 2 if row["valid"] else 0)


def lives_of(health: Iterable[Row]) -> list[dict[str, Any]]:
    """Return one row per life of a unit, from its health rows in chronological order."""
    lives: list[dict[str, Any]] = []
    repairs = 0
    for row in health:
        repairs += any(event["kind"] == EventKind.REPAIR for event in row["events"])
        hours = row["flight_hours"]
        if not math.isfinite(hours):
            continue
        if not lives or lives[-1]["life"] != repairs:
            # The first life began with the unit; events before its first test are unknown.
            begin = hours if repairs else 0.0
            life = {"life": repairs, "begin_hours": begin, "from_age": hours - begin}
            lives.append(life | {"has_failed": False})
        life = lives[-1]
        if not life["has_failed"]:
            life["to_age"] = hours - life["begin_hours"]
            life["has_failed"] = row["level"] == ERROR
    return lives
