# SPDX-License-Identifier: Apache-2.0
"""Bag task: conversion of a bag's telemetry to rows of estimates, counts and duty."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from ema_archive.settings import ArchiveSettings, estimation_software
from ema_archive.sources import calibration_of, content_digest, identity_of, local_copy
from ema_archive.tables import STAMPS, count_row, duty_row, estimate_row
from ema_bags.reader import Bag
from ema_bags.telemetry import described_actuators, read_telemetry
from ema_core.description import ActuatorDescription, UnitKey
from ema_monitor.diagnosis import Diagnosed, diagnose
from ema_monitor.model.threads import limit_threads
from ema_monitor.prognosis.duty.damage import FlownDuty
from ema_monitor.reason_texts import text_of
from ema_monitor.recordings.counts import read_counts
from ema_monitor.recordings.finding import find_recorded_windows
from ema_monitor.recordings.windows import BagWindows, RecordedWindow

DONE: Final = "done"
INCOMPLETE: Final = "incomplete"
DAMAGED: Final = "damaged"
FAILED: Final = "failed"
"""States of a bag: read completely, read in part because it is damaged, unreadable, or temporarily
unreadable."""


@dataclass(frozen=True)
class BagTask:
    """Task of a worker: estimates of a bag.

    ``url``, ``mark`` and ``calibration_url`` are as in `ema_archive.sources.Listed`.
    """

    url: str
    mark: str
    calibration_url: str
    settings: ArchiveSettings


@dataclass(frozen=True)
class UnitRows:
    """Rows of one unit in a bag: estimates, counts and duty.

    The calibration identity is empty if there was no calibration.
    """

    actuator_id: str
    serial_number: str
    model: str
    calibration_id: str
    estimates: list[dict[str, Any]]
    usage: list[dict[str, Any]]
    duty: list[dict[str, Any]]

    @property
    def unit(self) -> str:
        """Name of the unit in the tables."""
        return unit_name(self.actuator_id, self.serial_number)

    @property
    def stamps_ns(self) -> list[int]:
        """Timestamps of all rows [ns]."""
        tables = ((name, getattr(self, name)) for name in STAMPS)
        return [row[STAMPS[name]] for name, rows in tables for row in rows]


@dataclass(frozen=True)
class BagResult:
    """Result for a bag: its state and, unless the state is ``DONE``, the reason.

    A bag that is ``DONE`` but has no window also has a reason; remarks list further defects.
    ``end_ns`` is the log time of the last readable message [ns]; 0 if no message is readable.
    """

    task: BagTask
    state: str
    reason: str = ""
    sha256: str = ""
    remarks: list[str] = field(default_factory=list)
    units: list[UnitRows] = field(default_factory=list)
    software: str = field(default_factory=estimation_software)
    end_ns: int = 0


def unit_name(actuator_id: str, serial_number: str) -> str:
    """Return the name of a unit in the tables: actuator id and serial number, percent-encoded."""
    return f"{quote(actuator_id, safe=' ')}+{quote(serial_number, safe=' ')}"


def diagnose_bag(task: BagTask) -> BagResult:
    """Read a bag and return its estimates, as ``ema estimate -p warm_start=false`` prints them.

    If the bag cannot be used, the result states the reason.
    """
    # Bags are processed in parallel.
    limit_threads(1)
    copy = Path(task.url)
    try:
        with local_copy(task.url) as copy:
            sha256 = content_digest(copy)
            try:
                result = _diagnosed(task, copy, sha256)
            except ValueError as error:
                result = BagResult(task, DAMAGED, str(error), sha256)
    except OSError as error:
        text = str(error) if error.filename is None else f"{error.filename}: {error.strerror}"
        result = BagResult(task, FAILED, text)
    # Each message is one line, with the address of the bag instead of the path of a copy.
    return replace(
        result,
        reason=_plain(result.reason, copy, task.url),
        remarks=[_plain(remark, copy, task.url) for remark in result.remarks],
    )


def _diagnosed(task: BagTask, path: Path, sha256: str) -> BagResult:
    bag = Bag(path)
    present = described_actuators(bag)
    units, reasons, remarks = [], [], []
    # A bag of a single actuator is read without a selection.
    for actuator_id in present if len(present) > 1 else [None]:
        try:
            recorded = read_telemetry(bag, None, actuator_id)
            max_age_s = task.settings.measured_max_age_s
            bag_windows = find_recorded_windows(
                recorded, task.settings.trigger, measured_max_age_s=max_age_s, with_duty=True
            )
        except ValueError as error:
            reasons.append(str(error))
            continue
        # A window belongs to the unit in the description that was valid at its time.
        of_units: dict[UnitKey, list[RecordedWindow]] = {bag_windows.description.unit_key: []}
        for window in bag_windows.windows:
            of_units.setdefault(window.description.unit_key, []).append(window)
        remarks += bag_windows.remarks
        for windows in of_units.values():
            unit = windows[-1].description if windows else bag_windows.description
            flown = bag_windows.flown.get(unit.unit_key, [])
            rows, wrong = _rows_of_unit(task, bag, unit, windows, flown, sha256)
            units.append(rows)
            if len(of_units) == 1:
                remarks += wrong
        if not bag_windows.windows:
            reasons.append(_without_window(bag_windows))
    state = DONE if units else DAMAGED
    if units and not bag.is_whole:
        state, reasons = INCOMPLETE, [bag.damage, *reasons]
    end_ns = bag.end_ns or 0
    return BagResult(task, state, "; ".join(reasons), sha256, remarks, units, end_ns=end_ns)


def _rows_of_unit(
    task: BagTask,
    bag: Bag,
    unit: ActuatorDescription,
    windows: list[RecordedWindow],
    flown: list[tuple[int, FlownDuty]],
    sha256: str,
) -> tuple[UnitRows, list[str]]:
    """Return the rows of a unit in a bag, and messages about invalid counts."""
    calibration = calibration_of(task.settings.calibration or task.calibration_url, unit.unit_key)
    shared = {
        "actuator_id": unit.actuator_id,
        "serial_number": unit.serial_number,
        "bag": task.url,
        "bag_sha256": sha256,
        "software": estimation_software(),
        "settings": task.settings.estimation_id,
    }
    estimates = [
        estimate_row(diagnosed.estimate, diagnosed.number) | shared
        for diagnosed in diagnose(windows, calibration, task.settings.search)
        if isinstance(diagnosed, Diagnosed)
    ]
    counts, wrong = read_counts(bag, unit)
    usage = [count_row(count, number) | shared for number, count in enumerate(counts)]
    duty = [duty_row(*piece, number) | shared for number, piece in enumerate(flown)]
    calibration_id = identity_of(calibration)
    return UnitRows(*unit.unit_key, unit.model, calibration_id, estimates, usage, duty), wrong


def _without_window(bag_windows: BagWindows) -> str:
    """Return the reason why a bag has no window or record."""
    name = bag_windows.description.actuator_id
    if not bag_windows.description.is_modelled:
        why = f": {text_of(bag_windows.obstacle)}" if bag_windows.obstacle else ""
        return f"actuator {name!r} has no record to compare{why}"
    if not bag_windows.has_rested:
        why = "the command never rested"
    elif bag_windows.longest_motion_s:
        why = f"the command moved for at most {bag_windows.longest_motion_s:.3f} s, or one way only"
    else:
        why = "the command never moved"
    return f"actuator {name!r} has no window to diagnose (no excitation): {why}"


def _plain(words: str, path: Path, url: str) -> str:
    return " ".join(words.split()).replace(str(path), url)
