"""The task of a bag: from its telemetry to rows of estimates and counts."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from ema_archive.calibrations import calibration_of, identity_of
from ema_archive.partitions import month_of, shortened
from ema_archive.provenance import estimation_software
from ema_archive.settings import ArchiveSettings
from ema_archive.sources import content_digest, local_copy
from ema_archive.tables import count_row, estimate_row
from ema_bags.reader import Bag
from ema_bags.telemetry import described_actuators, read_telemetry
from ema_bags.usage import read_counts
from ema_bags.windows import BagWindows, RecordedWindow, find_recorded_windows
from ema_core.description import ActuatorDescription, UnitKey
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.diagnosis import Diagnosed, diagnose
from ema_monitor.model.threads import limit_threads

DONE: Final = "done"
DAMAGED: Final = "damaged"
FAILED: Final = "failed"
"""What became of a bag: it was read, it cannot be read, or it could not be read this time."""

_STAMPS: Final = {"estimates": "end_ns", "usage": "stamp_ns"}


@dataclass(frozen=True)
class BagTask:
    """What a worker is to do with a bag.

    Attributes
    ----------
    mark
        As it was listed.
    source
        Where its calibration comes from.
    """

    url: str
    mark: str
    source: str
    settings: ArchiveSettings


@dataclass(frozen=True)
class UnitRows:
    """What a bag says of one unit: its estimates and counts as rows.

    Attributes
    ----------
    calibration_id
        Identity of the calibration; empty when there was none.
    """

    actuator_id: str
    serial_number: str
    model: str
    calibration_id: str
    estimates: list[dict[str, Any]]
    usage: list[dict[str, Any]]

    @property
    def unit(self) -> str:
        """Name of the unit, as in paths."""
        return unit_name(self.actuator_id, self.serial_number)

    @property
    def months(self) -> list[str]:
        """Months that its rows are of, in order."""
        return sorted({month_of(stamp) for stamp in self.stamps_ns})

    @property
    def stamps_ns(self) -> list[int]:
        """Stamps of its rows [ns]."""
        stamps = [row[_STAMPS["estimates"]] for row in self.estimates]
        return stamps + [row[_STAMPS["usage"]] for row in self.usage]

    def rows(self, table: str, month: str) -> list[dict[str, Any]]:
        """Return its rows of a month in one of the tables "estimates" and "usage"."""
        stamp = _STAMPS[table]
        return [row for row in getattr(self, table) if month_of(row[stamp]) == month]


@dataclass(frozen=True)
class BagResult:
    """What became of a bag.

    Attributes
    ----------
    state, reason
        One of ``DONE``, ``DAMAGED``, ``FAILED``, and why it is not the first, or has no window.
    remarks
        What is wrong with it beside that.
    software
        Identity of the software of the worker.
    """

    task: BagTask
    state: str
    reason: str = ""
    sha256: str = ""
    remarks: list[str] = field(default_factory=list)
    units: list[UnitRows] = field(default_factory=list)
    software: str = field(default_factory=estimation_software)


def unit_name(actuator_id: str, serial_number: str) -> str:
    """Return the name of a unit, which may be that of a folder."""
    return shortened(f"{quote(actuator_id, safe=' ')}+{quote(serial_number, safe=' ')}")


def diagnose_bag(task: BagTask) -> BagResult:
    """Return the estimates of a bag, as ``ema estimate --no-warm-start`` gives them.

    A bag that cannot be used is a result as well, with the reason.
    """
    # Bags are done side by side.
    limit_threads(1)
    copy: Path | None = None
    try:
        with local_copy(task.url) as copy:
            sha256 = content_digest(copy)
            try:
                return _diagnosed(task, copy, sha256)
            except ValueError as error:
                return BagResult(task, DAMAGED, _in_words(error, copy, task.url), sha256)
    except OSError as error:
        return BagResult(task, FAILED, _in_words(error, copy, task.url))


def _diagnosed(task: BagTask, path: Path, sha256: str) -> BagResult:
    bag = Bag(path)
    present = described_actuators(bag)
    # Without a choice nothing is chosen: that is how a bag of one actuator is read.
    chosen = present if len(present) > 1 else [None]
    units, reasons, remarks = [], [], []
    for actuator_id in chosen:
        try:
            recorded = read_telemetry(bag, None, actuator_id)
            found = find_recorded_windows(
                recorded,
                task.settings.trigger,
                measured_max_age_s=task.settings.measured_max_age_s,
            )
        except ValueError as error:
            if len(chosen) == 1:
                raise
            reasons.append(_in_words(error, path, task.url))
            continue
        # Each window is of the unit that was described at its time.
        of_units: dict[UnitKey, list[RecordedWindow]] = {found.description.unit_key: []}
        for one in found.windows:
            of_units.setdefault(one.description.unit_key, []).append(one)
        remarks += [_plain(remark, path, task.url) for remark in found.remarks]
        for windows in of_units.values():
            unit = windows[-1].description if windows else found.description
            calibration = calibration_of(task.source, unit.actuator_id, unit.serial_number)
            counts, wrong = read_counts(bag, unit)
            units.append(
                UnitRows(
                    unit.actuator_id,
                    unit.serial_number,
                    shortened(unit.model),
                    identity_of(calibration),
                    _estimates(windows, calibration, task, sha256),
                    [
                        count_row(count, number) | _identity(unit) | {"bag": task.url}
                        for number, count in enumerate(counts)
                    ],
                )
            )
            if len(of_units) == 1:
                remarks += [_plain(remark, path, task.url) for remark in wrong]
        if not found.windows:
            reasons.append(_without_window(found, found.description))
    if not units:
        return BagResult(task, DAMAGED, "; ".join(reasons), sha256, remarks)
    return BagResult(task, DONE, "; ".join(reasons), sha256, remarks, units)


def _estimates(
    windows: list[RecordedWindow], calibration: AnyCalibration | str, task: BagTask, sha256: str
) -> list[dict[str, Any]]:
    shared = {
        "bag": task.url,
        "bag_sha256": sha256,
        "software": estimation_software(),
        "settings": task.settings.estimation_id,
    }
    return [
        estimate_row(one.estimate, one.number) | _identity(one.description) | shared
        for one in diagnose(windows, calibration, task.settings.search)
        if isinstance(one, Diagnosed)
    ]


def _identity(unit: ActuatorDescription) -> dict[str, str]:
    return {"actuator_id": unit.actuator_id, "serial_number": unit.serial_number}


def _without_window(found: BagWindows, unit: ActuatorDescription) -> str:
    if not found.has_rested:
        why = "the command never rested"
    elif found.longest_motion_s:
        why = f"the command moved for at most {found.longest_motion_s:.3f} s, or one way only"
    else:
        why = "the command never left its rest"
    return f"actuator {unit.actuator_id!r} has no window to diagnose (no excitation): {why}"


def _in_words(error: Exception, path: Path | None, url: str) -> str:
    words = str(error)
    if isinstance(error, OSError) and error.filename is not None:
        words = f"{error.filename}: {error.strerror}"
    return _plain(words, path, url)


def _plain(words: str, path: Path | None, url: str) -> str:
    """Return words as one line that names the bag by its address and not by that of a copy."""
    words = " ".join(words.split())
    return words if path is None else words.replace(str(path), url)
