"""The file of a history and those beside it, and what is wrong with them in words."""

import os
import shutil
import sqlite3
from itertools import count
from pathlib import Path


def copy_database(path: Path, copy: Path) -> None:
    """Copy a file and its log, if there is one."""
    for suffix in ("", "-wal"):
        if (source := with_suffix(path, suffix)).exists():
            shutil.copyfile(source, with_suffix(copy, suffix))


def code_of(error: Exception) -> int:
    """Return the primary result code of SQLite; 0 for other errors."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def reason_of(error: Exception) -> str:
    """Return in words what is wrong."""
    if isinstance(error, KeyError):
        return f"{error} is missing"
    if code_of(error) == sqlite3.SQLITE_BUSY:
        return "it is in use by another monitor"
    return getattr(error, "strerror", None) or str(error)


def with_suffix(path: Path, suffix: str) -> Path:
    """Return a path whose name has a suffix behind all that it has."""
    return path.with_name(path.name + suffix)


def free_name(path: Path) -> Path:
    """Return a name beside a file that nothing has yet."""
    names = (path.with_name(f"{path.stem}.set_aside_{n}{path.suffix}") for n in count(1))
    return next(name for name in names if not name.exists())


def file_id(path: Path) -> tuple[int, int]:
    """Return device and inode of a file; zeros when there is none."""
    try:
        status = os.stat(path)
    except FileNotFoundError:
        return 0, 0
    return status.st_dev, status.st_ino
