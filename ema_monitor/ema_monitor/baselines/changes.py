# SPDX-License-Identifier: Apache-2.0
"""Append-only history of a baseline's changes, with one line of JSON per change."""

import json
import os
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path

from ema_core.dates import utc_minute


class ChangeKind(StrEnum):
    """Kind of a baseline change."""

    ACCEPT = "accept"
    AUTOMATIC = "automatic"
    EXTEND = "extend"
    RESET = "reset"


@dataclass(frozen=True)
class BaselineChange:
    """A change of a baseline."""

    kind: ChangeKind
    author: str
    """Person or rule that made the change."""
    time_ns: int
    """Time of the change since 1970, UTC [ns]."""
    before: str
    """Identity of the calibration before the change; empty if there was none."""
    after: str
    """Identity of the calibration after the change; empty if there is none."""
    records: int
    """Number of records in the calibration after the change; for a reset, before it."""
    note: str = ""
    files: tuple[str, ...] = ()
    """File names of the records in the calibration after the change."""

    def __str__(self) -> str:
        number = f"{self.records} record" + ("" if self.records == 1 else "s")
        identity = self.after or self.before
        named = f" ({identity})" if identity else ""
        note = f": {self.note}" if self.note else ""
        return f"{utc_minute(self.time_ns)}  {self.kind} by {self.author}, {number}{named}{note}"


def append_change(path: Path, change: BaselineChange) -> None:
    """Append a change to a file and flush it to disk. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    line = json.dumps(asdict(change), ensure_ascii=False) + "\n"
    with path.open("ab+") as file:
        # Separate the change from a line that a crash cut off.
        if file.tell() and not _ends_a_line(path):
            file.write(b"\n")
        file.write(line.encode())
        file.flush()
        os.fsync(file.fileno())


def read_changes(path: Path) -> list[BaselineChange]:
    """Return the changes in a file, oldest first; damaged lines and a missing file are ignored."""
    changes = []
    try:
        lines = path.read_bytes().splitlines()
    except FileNotFoundError:
        return []
    for line in lines:
        try:
            content = json.loads(line)
            changes.append(
                BaselineChange(
                    ChangeKind(content["kind"]),
                    str(content["author"]),
                    int(content["time_ns"]),
                    str(content["before"]),
                    str(content["after"]),
                    int(content["records"]),
                    str(content.get("note", "")),
                    tuple(map(str, content.get("files", ()))),
                )
            )
        except (ValueError, KeyError, TypeError):
            continue
    return changes


def _ends_a_line(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"
