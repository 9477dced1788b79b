# SPDX-License-Identifier: Apache-2.0
"""Atomic writing of files, and reading of regular files only."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


@contextmanager
def complete_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path for writing, which is renamed to ``path`` if the block succeeds.

    Parameters
    ----------
    path
        File to write; an existing file is replaced once the new file is complete.

    Raises
    ------
    OSError
        If the file cannot be written; the error names the file, and no partial file remains. If
        only the directory cannot be synchronised, the new file exists, and the message warns that
        it may be lost in a power failure.
    """
    partial = path.with_name(f"{path.name}.partial")
    try:
        yield partial
        _synchronise(partial)  # a power failure might leave an empty file otherwise
        partial.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        partial.unlink(missing_ok=True)
    try:
        _synchronise(path.parent)  # the old file might reappear after a power failure otherwise
    except OSError as error:
        text = f"{error.strerror or error}: stored, but it may be lost in a power failure"
        raise OSError(error.errno, text, str(path)) from error


def _synchronise(path: Path) -> None:
    """Flush a file, or the entries of a directory, to disk."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def open_regular_file(path: Path) -> Iterator[BinaryIO]:
    """Open a regular file for reading and yield it; refuse pipes and devices without blocking.

    Raises
    ------
    ValueError
        If the path is not a regular file.
    OSError
        If the file cannot be read.
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
    """Raise ``ValueError`` if a path is a pipe, a device or a folder, and OSError if unreadable."""
    with open_regular_file(path):
        pass


def read_regular_file(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file.

    Raises
    ------
    ValueError
        If the path is not a regular file, or the file is larger than ``most_bytes``.
    OSError
        If the file cannot be read.
    """
    with open_regular_file(path) as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise ValueError(f"{path} is larger than {most_bytes:,} bytes")
    return content
