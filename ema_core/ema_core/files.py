"""Files that are written completely or not at all, and read when they can be."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def complete_file(path: Path) -> Iterator[Path]:
    """Yield a temporary name to write to; the file is renamed when the block ends.

    Parameters
    ----------
    path
        File to write; an existing one is replaced once the new one is complete.

    Raises
    ------
    OSError
        When it cannot be written; the error names the file, and no part of it is left. It says so
        where only the new name is not certain: the new file is there, and may be lost with power.
    """
    partial = path.with_name(f"{path.name}.partial")
    try:
        yield partial
        _synchronise(partial)  # else a loss of power may leave the new name with nothing
        partial.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        partial.unlink(missing_ok=True)
    try:
        _synchronise(path.parent)  # else the old file may reappear after a loss of power
    except OSError as error:
        words = f"{error.strerror or error}: it is stored, and lost if the power is lost soon"
        raise OSError(error.errno, words, str(path)) from error


def _synchronise(path: Path) -> None:
    """Wait until a file, or the names in a directory, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def open_regular_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file to be read; neither a pipe nor a device is waited for.

    Raises
    ------
    ValueError
        When it is not a regular file.
    OSError
        When it cannot be read.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise ValueError(f"{path} is not a regular file")
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            yield file
    finally:
        os.close(descriptor)


def require_regular_file(path: Path) -> None:
    """Raise ``ValueError`` if a file is a pipe or a device, which may never end."""
    with open_regular_file(path):
        pass


def read_regular_file(path: Path, most_bytes: int) -> bytes:
    """Return the content of a file that is opened as by `open_regular_file`.

    Raises
    ------
    ValueError
        When it is not a regular file, or larger than ``most_bytes``.
    OSError
        When it cannot be read.
    """
    with open_regular_file(path) as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise ValueError(f"{path} is larger than {most_bytes:,} bytes")
    return content
