# SPDX-License-Identifier: Apache-2.0
"""Healthy records of a unit in compressed files, and the choice of records to keep."""

import hashlib
import math
import zipfile
import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import numpy as np

from ema_core.causes import CauseEstimate
from ema_core.dates import has_date
from ema_core.files import complete_file
from ema_core.telemetry import COLUMNS, SERIES, Telemetry
from ema_monitor.joint.record import NS_A_DAY
from ema_monitor.windows.window import Window

_SUFFIX: Final = ".npz"
_DAMAGES: Final = (ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""Errors of :mod:`zipfile` and ``numpy.load`` for a damaged file."""

_ANGLES: Final = ("command", "position")
"""Columns that are stored relative to the first position: a multi-turn angle exceeds float32."""


class StoredRecord(NamedTuple):
    """A stored record; records are sorted by stamp."""

    stamp_ns: int
    """Stamp of the first sample [ns]."""
    path: Path
    """File of the record."""

    @property
    def day(self) -> int:
        """Day of the record [days since 1970]; 0 if its stamp has no date."""
        return self.stamp_ns // NS_A_DAY if has_date(self.stamp_ns) else 0


class RecordFiles:
    """Records in a folder, one file each.

    Parameters
    ----------
    folder
        The folder; it is created with the first record.

    Attributes
    ----------
    stored
        The stored records, in the order of their stamps.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.stored = sorted(_listed(folder))

    def add(self, window: Window) -> StoredRecord | None:
        """Store a record and return it; return None if it is already stored.

        Raises
        ------
        OSError
            If the file cannot be written; no partial file remains.
        """
        telemetry = window.telemetry
        content = hashlib.sha256((telemetry.position - telemetry.position[0]).astype(np.float32))
        name = f"{telemetry.stamp_ns}-{content.hexdigest()[:8]}{_SUFFIX}"
        record = StoredRecord(telemetry.stamp_ns, self._folder / name)
        if record in self.stored:
            return None
        self._folder.mkdir(parents=True, exist_ok=True)
        with complete_file(record.path) as partial, partial.open("wb") as file:
            np.savez_compressed(file, **_arrays(window))
        self.stored = sorted([*self.stored, record])
        return record

    def remove(self, records: Sequence[StoredRecord]) -> None:
        """Delete the files of records."""
        removed = set(records)
        for record in removed:
            record.path.unlink(missing_ok=True)
        self.stored = [record for record in self.stored if record not in removed]

    def read(self, records: Sequence[StoredRecord]) -> list[Window]:
        """Return the windows of records; damaged files are deleted and left out.

        Raises
        ------
        OSError
            If an existing file cannot be read; it remains.
        """
        windows, damaged = [], []
        for record in records:
            try:
                windows.append(_window(record.path))
            except (FileNotFoundError, *_DAMAGES):
                damaged.append(record)
        self.remove(damaged)
        return windows


def thinned(records: Sequence[StoredRecord], most: int) -> list[StoredRecord]:
    """Return at most ``most`` records, spread over their days.

    Records are left out one by one, from the day with the most records or the earliest such day.
    Within a day, the record whose neighbours in time are closest to each other is left out.
    """
    kept = sorted(records)
    while len(kept) > most:
        counts = Counter(record.day for record in kept)
        crowded = max(sorted(counts), key=lambda day: counts[day])
        day = [record for record in kept if record.day == crowded]
        kept.remove(_most_crowded(day))
    return kept


def _most_crowded(day: Sequence[StoredRecord]) -> StoredRecord:
    """Return the record whose neighbours are closest in time; never the first or the last.

    If there are fewer than three records, the last is returned.
    """
    if len(day) < 3:
        return day[-1]
    spans = [after.stamp_ns - before.stamp_ns for before, after in zip(day, day[2:], strict=False)]
    return day[1 + spans.index(min(spans))]


def _listed(folder: Path) -> list[StoredRecord]:
    """Return the records in a folder; files with other names are ignored."""
    if not folder.is_dir():
        return []
    stamps = [(path, path.name.partition("-")[0]) for path in folder.glob(f"*{_SUFFIX}")]
    return [StoredRecord(int(stamp), path) for path, stamp in stamps if stamp.isdecimal()]


def _arrays(window: Window) -> dict[str, Any]:
    telemetry = window.telemetry
    origin = float(telemetry.position[0])
    columns = {name: getattr(telemetry, name) for name in SERIES}
    measured = {cause.name: (cause.value, cause.sigma) for cause in window.measured}
    return {
        "stamp_ns": np.array(telemetry.stamp_ns, dtype=np.int64),
        "sample_period": np.array(telemetry.sample_period),
        "first_index": np.array(telemetry.first_index, dtype=np.int64),
        "origin": np.array(origin),
        "interpolated": np.flatnonzero(telemetry.interpolated),
        "omitted": np.array([(item.start, item.stop) for item in window.omitted], dtype=np.int64),
        "temperature": np.array(measured.get("winding_temperature", (math.nan, math.nan))),
        **{
            name: (column - origin if name in _ANGLES else column).astype(np.float32)
            for name, column in columns.items()
        },
    }


def _window(path: Path) -> Window:
    """Return the record in a file; checksums are verified before any array header is parsed."""
    with path.open("rb") as file:
        with zipfile.ZipFile(file) as members:
            if damaged := members.testzip():
                raise zipfile.BadZipFile(f"{path}: checksum of {damaged} is wrong")
        file.seek(0)
        return _decoded(file)


def _decoded(file: IO[bytes]) -> Window:
    with np.load(file, allow_pickle=False) as arrays:
        origin = float(arrays["origin"])
        columns = {
            name: arrays[name].astype(np.float64) for name in SERIES if name in (*arrays, *COLUMNS)
        }
        for name in _ANGLES:
            columns[name] += origin
        lost, samples = arrays["interpolated"], len(columns["position"])
        interpolated = np.zeros(samples if len(lost) else 0, dtype=bool)
        interpolated[lost] = True
        telemetry = Telemetry(
            int(arrays["stamp_ns"]),
            float(arrays["sample_period"]),
            int(arrays["first_index"]),
            **columns,
            interpolated=interpolated,
        )
        omitted = tuple(range(*map(int, item)) for item in arrays["omitted"])
        value, sigma = map(float, arrays["temperature"])
    measured = () if math.isnan(value) else (CauseEstimate("winding_temperature", value, sigma),)
    return Window(telemetry, measured=measured, omitted=omitted)
