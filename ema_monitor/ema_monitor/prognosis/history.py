"""The history of one unit, test by test, in a file that survives being killed at any moment.

The file is JSON lines: a header with format and unit, then a test a line, each flushed to the
disk before the next, each with a checksum of its own.
"""

import fcntl
import os
import shutil
from pathlib import Path
from typing import BinaryIO, Final
from urllib.parse import quote

from ema_monitor.prognosis.history_entry import (
    Entry,
    UnusedCycle,
    as_line,
    from_line,
    read_line,
)

FORMAT: Final = "ema_history 2"

_READABLE: Final = ("ema_history 1", FORMAT)

_LONGEST_LINE: Final = 65_536


class History:
    """Tests of one unit, in memory and, where there is a path, in a file.

    A last line that was cut off is dropped. A file that is corrupted, of another unit or of
    another format is renamed, and a new one begun; one that is deleted or moved while in use is
    written anew. Nothing here raises because of a file: what is wrong is told, and the history goes
    on in memory.

    Parameters
    ----------
    actuator_id, serial_number
        The unit.
    path
        The file; None for memory alone. It and its folder are made with the first entry.

    Attributes
    ----------
    entries
        The valid tests in the order in which they came.
    unused_cycles
        How many test cycles since the latest of them had no valid estimate.
    """

    def __init__(self, actuator_id: str, serial_number: str, path: Path | None = None) -> None:
        self.entries: list[Entry] = []
        self.unused_cycles = 0
        self._tests: list[Entry | UnusedCycle] = []
        self._stamps_ns: set[int] = set()
        self._unit = {"actuator_id": actuator_id, "serial_number": serial_number}
        self._path = path
        self._file: BinaryIO | None = None
        self._end = 0
        # What is not in the file yet, for want of a file or of space.
        self._unwritten = b""
        self._mended = ""
        self._trouble = ""
        if path is not None:
            try:
                self._open(path)
            except OSError as error:
                self._trouble = f"the history {path} cannot be read: {error.strerror or error}"
                self.close()

    @property
    def path(self) -> Path | None:
        """The file in use; None when the history is in memory alone."""
        return self._path

    @property
    def problem(self) -> str:
        """What is wrong, or was with the file; empty when nothing."""
        return "; ".join(filter(None, [self._mended, self._trouble]))

    def holds(self, stamp_ns: int) -> bool:
        """Return whether the window that ends at a stamp [ns] is in the history, valid or not."""
        return stamp_ns in self._stamps_ns

    def holds_valid(self, stamp_ns: int) -> bool:
        """Return whether a valid test of the window that ends at a stamp [ns] is."""
        return any(entry.stamp_ns == stamp_ns for entry in reversed(self.entries))

    def append(self, test: Entry | UnusedCycle) -> None:
        """Add a test, and wait until the disk has it.

        Parameters
        ----------
        test
            The test.
        """
        self._take(test)
        if self._path is None:
            return
        self._unwritten += test.line()
        try:
            if self._file is not None and not _is_file_at(self._path, self._file):
                self._begin_anew()
            if self._file is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                if self._lock(self._path) and self._holds_unread():
                    self._trouble = (
                        f"the history {self._path} was written by another monitor since this one "
                        "began; this one's is in memory only until it starts again"
                    )
                    self.close()
            if self._file is not None:
                self._write(self._file)
        except OSError as error:
            self._trouble = (
                f"the history {self._path} cannot be written: {error.strerror or error}; "
                "tests since then are in memory only"
            )
        else:
            if self._file is not None:
                self._trouble = ""

    def close(self) -> None:
        """Let go of the file; what is added from now on is in memory only."""
        self._path = None
        self._release()

    def _begin_anew(self) -> None:
        """Have everything written to a new file, for that in use is no longer at its place."""
        self._mended = (
            f"the history {self._path} was deleted or moved while it was in use; a new file with "
            "all its tests is begun"
        )
        self._release()
        self._end = 0
        self._unwritten = b"".join(test.line() for test in self._tests)

    def _take(self, test: Entry | UnusedCycle) -> None:
        self._tests.append(test)
        self._stamps_ns.add(test.stamp_ns)
        if isinstance(test, Entry):
            self.entries.append(test)
            self.unused_cycles = 0
        else:
            self.unused_cycles += 1

    def _release(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def _open(self, path: Path) -> None:
        """Read a file that is there, and set it aside when it is of no use."""
        if not path.exists() or not self._lock(path) or self._file is None:
            return
        content = self._file.read()
        whole = content[: content.rfind(b"\n") + 1]
        is_cut = _is_cut_line(content[len(whole) :])
        try:
            if not whole and not is_cut:
                raise ValueError("it holds no line of a history")
            header, *lines = whole.splitlines() or [b""]
            if whole:
                self._check_header(header)
            tests = [read_line(line) for line in lines]
        except (ValueError, KeyError, TypeError) as error:
            self._release()
            aside = _free_name(path)
            path.rename(aside)
            self._mended = (
                f"the history {path} is set aside as {aside.name} and a new one is begun: "
                f"{_reason(error)}"
            )
            return
        self._end = len(whole)
        for test in tests:
            self._take(test)
        if not is_cut:
            aside = _free_name(path)
            shutil.copy2(path, aside)
            _sync(aside)
            _sync(path.parent)
            self._file.truncate(self._end)
            os.fsync(self._file.fileno())
            self._mended = (
                f"the history {path} has a damaged end, which is left out; the file as it was is "
                f"kept as {aside.name}"
            )

    def _holds_unread(self) -> bool:
        """Return whether the file has more in it than was read of it."""
        return self._file is not None and self._file.seek(0, os.SEEK_END) > self._end

    def _lock(self, path: Path) -> bool:
        """Open the file for this process alone; return whether no other one has it."""
        is_new = not path.exists()
        file = path.open("x+b" if is_new else "r+b")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            self._trouble = (
                f"the history {path} is in use by another monitor; this one's is in memory only"
            )
            self._path = None
            return False
        except OSError:
            # A file system without locks.
            pass
        self._file = file
        if is_new:
            _sync(path.parent)
        return True

    def _write(self, file: BinaryIO) -> None:
        # Over what a write that failed has left behind.
        file.seek(self._end)
        file.truncate()
        header = b"" if self._end else as_line({"format": FORMAT, **self._unit})
        file.write(header + self._unwritten)
        file.flush()
        os.fsync(file.fileno())
        self._end += len(header) + len(self._unwritten)
        self._unwritten = b""

    def _check_header(self, line: bytes) -> None:
        try:
            values = from_line(line)
        except ValueError as error:
            raise ValueError(f"it does not begin with a header of {FORMAT!r}: {error}") from error
        if values.get("format") not in _READABLE:
            raise ValueError(f"its format is {values.get('format')!r}, expected {FORMAT!r}")
        for name, own in self._unit.items():
            if values.get(name) != own:
                raise ValueError(f"it is of {name} {values.get(name)!r}, not {own!r}")


def history_path(folder: Path, actuator_id: str, serial_number: str) -> Path:
    """Return where in a folder the history of a unit is.

    Parameters
    ----------
    folder
        The folder.
    actuator_id, serial_number
        The unit.
    """
    return folder / f"{quote(actuator_id, safe=' ')}+{quote(serial_number, safe=' ')}.jsonl"


def _is_cut_line(tail: bytes) -> bool:
    """Return whether what follows the last whole line is the beginning of one, or nothing."""
    return b"\0" not in tail and len(tail) < _LONGEST_LINE and tail[:1] in (b"", b"{")


def _reason(error: Exception) -> str:
    return f"{error} is missing" if isinstance(error, KeyError) else str(error)


def _free_name(path: Path) -> Path:
    """Return a name beside a file that nothing has yet."""
    number = 1
    while True:
        name = path.with_name(f"{path.stem}.set_aside_{number}{path.suffix}")
        if not name.exists():
            return name
        number += 1


def _is_file_at(path: Path, file: BinaryIO) -> bool:
    """Return whether an open file is still the one that a path names."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def _sync(path: Path) -> None:
    """See to it that a new file, or the name of one in a folder, is on the disk as well."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
