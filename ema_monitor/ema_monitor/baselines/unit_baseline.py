# SPDX-License-Identifier: Apache-2.0
"""Baseline of one unit on disk: candidate records, accepted calibration and history of changes."""

import fcntl
import logging
import math
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Final, Self
from urllib.parse import unquote

import yaml

from ema_core.description import ActuatorDescription
from ema_core.files import complete_file
from ema_core.wording import counted, one_line
from ema_monitor.baselines.changes import BaselineChange, ChangeKind, append_change, read_changes
from ema_monitor.baselines.progress import (
    FEWEST,
    BaselineProgress,
    forward_share,
    progress_of,
    refusal_of,
)
from ema_monitor.baselines.record_files import RecordFiles, StoredRecord, thinned
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.calibrations import CALIBRATION_FILE, file_name, load_calibration
from ema_monitor.windows.window import Window

MOST_RECORDS: Final = 60
"""Largest number of records of a baseline, and of candidates while learning."""

MOST_CANDIDATES: Final = 30
"""Largest number of candidates in addition to an accepted baseline."""

DESCRIPTION_FILE: Final = "description.yaml"

_RECORDS: Final = "records"
_CHANGES: Final = "changes.jsonl"
_LOCK: Final = "lock"
_PENDING: Final = "calibration.pending.yaml"
_REFIT_SHARE: Final = 3
_LONGEST_PERSON: Final = 60
_LONGEST_NOTE: Final = 500

_log = logging.getLogger(__name__)


def default_folder() -> Path:
    """Return the default folder of baselines, ``ema/baselines`` in ``ROS_HOME`` or ``~/.ros``."""
    return Path(os.environ.get("ROS_HOME") or "~/.ros").expanduser() / "ema" / "baselines"


def unit_folder(folder: Path, actuator_id: str, serial_number: str) -> Path:
    """Return the folder of a unit in a folder of baselines."""
    return folder / file_name(actuator_id) / file_name(serial_number)


def calibration_pattern(folder: Path) -> str:
    """Return the value of ``calibration_file`` that finds accepted calibrations in a folder."""
    return str(folder / "{actuator_id}" / "{serial_number}" / CALIBRATION_FILE)


def stored_units(folder: Path) -> dict[str, Path]:
    """Return the description file of each actuator's latest unit, keyed by actuator."""
    files = folder.glob(f"*/*/{DESCRIPTION_FILE}")
    by_age = sorted(files, key=lambda path: path.stat().st_mtime)
    return {unquote(path.parent.parent.name): path for path in by_age}


def changes_of(folder: Path, actuator_id: str, serial_number: str) -> list[BaselineChange]:
    """Return the history of the changes of a unit's baseline."""
    return read_changes(unit_folder(folder, actuator_id, serial_number) / _CHANGES)


class InUseError(OSError):
    """Another process holds the baseline of the unit."""


class UnitBaseline:
    """Baseline of one unit on disk, held by one process at a time.

    A unit without an accepted calibration is learning: it collects candidate records. Later
    candidates are records without a departure, which only ``extend`` adds to the calibration.

    Killing the process at any time leaves a usable state: a change is written to the history
    before it takes effect, and is completed when the baseline is opened next. A damaged calibration
    is fitted again from its records. If that fails, the baseline is neither used nor learned until
    it is reset.

    Parameters
    ----------
    folder
        Folder of the baselines of all units.
    description
        The unit.
    has_clock
        Whether stamps come from a clock; if not, all records count as records of one day.

    Attributes
    ----------
    calibration
        Accepted calibration; None while learning.
    provisional
        Calibration fitted to the candidates while learning; None until there are enough candidates.
    changes
        History of the changes.
    damage
        Why the accepted baseline cannot be determined; empty otherwise.

    Raises
    ------
    InUseError
        If another process holds the baseline.
    OSError
        If the folder cannot be written.
    """

    def __init__(
        self, folder: Path, description: ActuatorDescription, *, has_clock: bool = True
    ) -> None:
        self.description = description
        self._has_clock = has_clock
        self._folder = unit_folder(folder, *description.unit_key)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._lock = _locked(self._folder / _LOCK)
        try:
            self.changes = read_changes(self._folder / _CHANGES)
            self._records = RecordFiles(self._folder / _RECORDS)
            self._complete()
            self.damage = ""
            self.calibration = self._loaded()
            self._write_description()
        except BaseException:
            self.close()
            raise
        self.provisional: JointCalibration | None = None
        self._reason = ""
        self._forward_share = math.nan
        # Number of records in the latest fit, and of records added since then.
        self._fitted, self._added = 0, len(self.candidates)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the baseline for other processes."""
        with suppress(OSError):
            os.close(self._lock)
        self._lock = -1

    @property
    def is_accepted(self) -> bool:
        """Whether the unit has an accepted baseline."""
        return self.calibration is not None

    @property
    def candidates(self) -> list[StoredRecord]:
        """Stored records that are not part of the accepted baseline."""
        members = self._members
        return [record for record in self._records.stored if record not in members]

    @property
    def _members(self) -> set[StoredRecord]:
        """Stored records of the accepted baseline."""
        if self.calibration is None:
            return set()
        if self._accepting is not None:
            names = set(self._accepting.files)
            return {record for record in self._records.stored if record.path.name in names}
        # The line of the history is damaged, or the calibration was edited by hand.
        stamps = {record.stamp_ns for record in self.calibration.baseline.records}
        members = {record for record in self._records.stored if record.stamp_ns in stamps}
        return members or set(self._records.stored)

    @property
    def latest_ns(self) -> int:
        """Stamp of the latest stored record [ns]; 0 without records."""
        return self._records.stored[-1].stamp_ns if self._records.stored else 0

    @property
    def accepted_by(self) -> BaselineChange | None:
        """The change that produced the accepted baseline; None while learning, or if unknown."""
        return self._accepting if self.is_accepted else None

    @property
    def _accepting(self) -> BaselineChange | None:
        """The latest change that produced the calibration; None if the history lacks it."""
        identity = self.calibration.calibration_id if self.calibration else ""
        matching = (item for item in reversed(self.changes) if item.after == identity)
        return next(matching, None) if identity else None

    def add(self, window: Window) -> bool:
        """Store a record as a candidate. Return whether it is new.

        While learning, the caller adds every usable record; after that, only records without a
        departure. Surplus candidates are deleted from the most crowded day.

        Raises
        ------
        OSError
            If the record cannot be written.
        ValueError
            If the baseline is damaged.
        """
        self._require_sound()
        if self._records.add(window) is None:
            return False
        self._added += 1
        candidates = self.candidates
        most = MOST_CANDIDATES if self.is_accepted else MOST_RECORDS
        kept = set(thinned(candidates, most))
        self._records.remove([record for record in candidates if record not in kept])
        return True

    @property
    def is_fit_due(self) -> bool:
        """Whether enough records were added for a new provisional fit.

        Fits are spaced in proportion to the number of records, which bounds the total work.
        """
        if self.damage or self.is_accepted or len(self.candidates) < FEWEST:
            return False
        return self._added >= max(1, self._fitted // _REFIT_SHARE)

    def fit(self) -> None:
        """Fit the provisional calibration to the candidates.

        If they determine no calibration, ``provisional`` is None, and `progress` has the reason.
        """
        self.provisional = None
        try:
            self.provisional = self._fitted_to(self.candidates)
            self._reason = refusal_of(self.provisional)
        except ValueError as error:
            self._reason = str(error)
        self._fitted, self._added = len(self.candidates), 0

    def progress(self, records_needed: int = 0) -> BaselineProgress:
        """Return the progress of the accepted baseline, or of the candidates while learning."""
        if self.calibration is not None:
            days = len(set(self.calibration.baseline.days))
            count = self.calibration.windows
            return progress_of(self.calibration, count, days, self._forward_share, "")
        records, reason = self.candidates, self.damage or self._reason
        if not reason and len(records) < FEWEST:
            reason = f"a baseline needs at least {FEWEST} records"
        days = len({record.day for record in records}) if self._has_clock else min(1, len(records))
        share = self._forward_share
        return progress_of(self.provisional, len(records), days, share, reason, records_needed)

    def accept(
        self, author: str, note: str = "", *, force: bool = False, is_automatic: bool = False
    ) -> BaselineChange:
        """Accept the candidates as the baseline. Return the recorded change.

        Parameters
        ----------
        author
            Person or rule that accepts the baseline.
        note
            Reason, for the history.
        force
            Accept the baseline although some records are outliers or friction rises.
        is_automatic
            Whether a rule accepts the baseline.

        Raises
        ------
        ValueError
            If the unit has an accepted baseline, or the candidates cannot become one; the message
            names the reason.
        OSError
            If the baseline cannot be written.
        """
        self._require_sound()
        if self.calibration is not None:
            raise ValueError(
                f"the unit has the accepted baseline {self.calibration.calibration_id}: extend it, "
                "or reset it first"
            )
        records = self.candidates
        if len(records) < FEWEST:
            raise ValueError(
                f"{counted(len(records), 'record')}: a baseline needs at least {FEWEST}"
            )
        if self._added or self.provisional is None:
            self.fit()
        if self.provisional is None:
            raise ValueError(f"the baseline is refused: {self._reason}")
        calibration = _judged(self.provisional, "baseline", force=force)
        kind = ChangeKind.AUTOMATIC if is_automatic else ChangeKind.ACCEPT
        return self._install(calibration, records, kind, author, note)

    def extend(self, author: str, note: str = "", *, force: bool = False) -> BaselineChange:
        """Add the candidates to the accepted baseline. Return the recorded change.

        See ``accept`` for parameters and errors. The baseline must be accepted, and have
        candidates.
        """
        self._require_sound()
        if self.calibration is None:
            raise ValueError("the unit has no accepted baseline: accept one first")
        if not self.candidates:
            raise ValueError(
                "there is nothing to extend the baseline with: no later record agrees with it in "
                "all quantities"
            )
        records = thinned(self._records.stored, MOST_RECORDS)
        fitted = self._fitted_to(records).with_labels_of(self.calibration)
        calibration = _judged(fitted, "extension", force=force)
        change = self._install(calibration, records, ChangeKind.EXTEND, author, note)
        self._records.remove(self.candidates)  # thinned out
        return change

    def reset(self, author: str, note: str = "") -> BaselineChange:
        """Discard baseline and candidates, and learn again. Return the recorded change.

        The history of the changes remains.
        """
        count = self.calibration.windows if self.calibration else len(self.candidates)
        change = self._changed(ChangeKind.RESET, author, note, "", count)
        self._discard()
        self.calibration = self.provisional = None
        self.damage = self._reason = ""
        self._forward_share = math.nan
        self._fitted = self._added = 0
        return change

    def _discard(self) -> None:
        """Delete records and calibration, the calibration last."""
        self._records.remove(self._records.stored)
        (self._folder / CALIBRATION_FILE).unlink(missing_ok=True)

    def _install(
        self,
        calibration: JointCalibration,
        records: Sequence[StoredRecord],
        kind: ChangeKind,
        author: str,
        note: str,
    ) -> BaselineChange:
        """Write a calibration with its change, and return the change.

        If the process is killed meanwhile, either both take effect or neither.
        """
        calibration.save(self._folder / _PENDING)
        files = tuple(record.path.name for record in records)
        identity, count = calibration.calibration_id, calibration.windows
        change = self._changed(kind, author, note, identity, count, files)
        self._complete()
        self.calibration, self.provisional = calibration, None
        self._fitted = self._added = 0
        return change

    def _changed(
        self,
        kind: ChangeKind,
        author: str,
        note: str,
        after: str,
        records: int,
        files: tuple[str, ...] = (),
    ) -> BaselineChange:
        author = one_line("person", author, _LONGEST_PERSON)
        note = one_line("note", note, _LONGEST_NOTE) if note else ""
        before = self.calibration.calibration_id if self.calibration else ""
        change = BaselineChange(kind, author, time.time_ns(), before, after, records, note, files)
        append_change(self._folder / _CHANGES, change)
        self.changes.append(change)
        return change

    def _complete(self) -> None:
        """Complete the latest change, even if the process was killed during the change."""
        if not self.changes:
            return
        latest, pending = self.changes[-1], self._folder / _PENDING
        path = self._folder / CALIBRATION_FILE
        if latest.kind is ChangeKind.RESET and path.exists() and _identity(path) == latest.before:
            self._discard()  # both identities are empty if damaged
        if pending.exists():
            if _identity(pending) == latest.after:
                pending.replace(path)
            pending.unlink(missing_ok=True)

    def _loaded(self) -> JointCalibration | None:
        """Return the accepted calibration; None while learning, or with ``damage`` set.

        If the file is damaged or missing, the calibration is fitted again from its records, without
        labels. If this is impossible, ``damage`` is set.
        """
        path = self._folder / CALIBRATION_FILE
        latest = self.changes[-1] if self.changes else None
        try:
            calibration = load_calibration(path)
            if isinstance(calibration, JointCalibration):
                return calibration
            damage = f"{path} is not a calibration of a unit with an unknown drive"
        except FileNotFoundError:
            if latest is None or not latest.after:
                return None
            damage = f"{path} is missing, although a baseline was accepted"
        except ValueError as error:
            damage = str(error)
        restored = self._restored(latest) if latest else None
        if restored is None:
            self.damage = f"{damage}: restore the file from a copy, or reset the baseline"
        else:
            _log.warning("%s: the baseline was fitted again from its records, without labels", path)
        return restored

    def _restored(self, accepting: BaselineChange) -> JointCalibration | None:
        """Fit the calibration of a change again, store and return it.

        Returns None if the records do not reproduce the original calibration.
        """
        names = set(accepting.files)
        records = [record for record in self._records.stored if record.path.name in names]
        if not accepting.after or len(records) < max(1, len(names)):
            return None
        try:
            fitted = self._fitted_to(records)
        except ValueError:
            return None
        if fitted.calibration_id != accepting.after:
            return None
        fitted.save(self._folder / CALIBRATION_FILE)
        return fitted

    def _require_sound(self) -> None:
        if self.damage:
            raise ValueError(self.damage)

    def _fitted_to(self, records: Sequence[StoredRecord]) -> JointCalibration:
        """Return the calibration fitted to records; ValueError if they determine none."""
        windows = self._records.read(records)
        if not self._has_clock:
            windows = [window.without_date() for window in windows]
        calibration = calibrate_joint(windows, self.description)
        self._forward_share = forward_share(windows)
        return calibration

    def _write_description(self) -> None:
        """Store the description, which lets commands fit the records without a monitor."""
        path = self._folder / DESCRIPTION_FILE
        described = self.description
        content = asdict(described)
        content["parameters"] = described.parameters.as_mapping()
        text = yaml.safe_dump(content, sort_keys=False)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            with complete_file(path) as partial:
                partial.write_text(text, encoding="utf-8")


def _judged(calibration: JointCalibration, name: str, *, force: bool) -> JointCalibration:
    """Return a calibration that can be accepted; ValueError if it cannot."""
    if reason := refusal_of(calibration, accepts_outliers=force):
        raise ValueError(f"the {name} is refused: {reason}")
    return calibration


def _identity(path: Path) -> str:
    """Return the identity of a calibration file; empty if it cannot be read."""
    try:
        return load_calibration(path).calibration_id
    except (OSError, ValueError):
        return ""


def _locked(path: Path) -> int:
    """Return the descriptor of a locked file; the lock ends with the process.

    Raises InUseError if another process has the lock.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        raise InUseError(
            error.errno, "another process, such as a running monitor, uses this baseline", str(path)
        ) from error
    return descriptor
