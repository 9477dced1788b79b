# SPDX-License-Identifier: Apache-2.0
"""Listing and local copies of bags and calibrations, in folders and object stores."""

import errno
import hashlib
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC
from functools import lru_cache
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import fsspec
from fsspec.implementations.local import LocalFileSystem
from fsspec.utils import get_protocol

from ema_bags.metadata import METADATA_FILE
from ema_bags.suffixes import BAGS
from ema_core.description import UnitKey
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import CALIBRATION_FILE, AnyCalibration, load_calibration
from ema_monitor.reasons import CalibrationMissing, CalibrationUnusable, NoCalibration, Reason

_OF_THE_LOCAL_DISK: Final = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EMFILE)
_CHANGE_MARKS: Final = ("ETag", "etag", "md5Hash", "mtime", "LastModified", "last_modified")


@dataclass(frozen=True)
class Listed:
    """A bag in the listing of a folder or object store."""

    url: str
    """Path, or address in an object store."""
    size: int
    """Size [bytes]."""
    mark: str
    """Token that changes with the content: size, and either the store's checksum or modification
    time."""
    calibration_url: str
    """Address of the calibration in the same folder; empty if there is none."""


def list_bags(source: str, without: Path) -> Iterator[list[Listed]]:
    """Yield the bags of each folder that directly contains bags, sorted by address.

    Parameters
    ----------
    source
        A folder, or the address of a folder in an object store in the notation of fsspec.
    without
        A local folder to skip.

    Raises
    ------
    ValueError
        If the address belongs to an unsupported store.
    OSError
        If the source cannot be read or does not exist.
    """
    files, root = _opened(source)
    with _clear_errors(source):
        if not files.isdir(root):
            with suppress(FileNotFoundError):
                # Raise the store's own error, which was reported as a missing folder until here.
                files.info(root)
                raise NotADirectoryError(f"{source}: this is a file, not a folder of bags")
            raise FileNotFoundError(f"{source} not found: expected a folder of bags")
        for folder, folders, entries in files.walk(root, detail=True, on_error="raise"):
            if isinstance(files, LocalFileSystem) and Path(folder) == without:
                folders.clear()
            elif bags := _bags_in(files, folders, entries):
                yield sorted(bags, key=lambda bag: bag.url)


def _bags_in(files: Any, folders: dict[str, Any], entries: dict[str, Any]) -> list[Listed]:
    """Return the bags of a folder. Subfolders that are bags themselves are not searched."""
    # Bags in sqlite3 storage are listed so that reading them reports the remedy.
    bags = [(info, [info]) for name, info in entries.items() if name.endswith(BAGS)]
    for name, info in sorted(folders.items()):
        inside = files.ls(info["name"], detail=True)
        if any(item["name"].endswith(f"/{METADATA_FILE}") for item in inside):
            del folders[name]
            bags.append((info, sorted(inside, key=lambda item: item["name"])))
    entry = entries.get(CALIBRATION_FILE)
    calibration = _url(files, entry["name"]) if entry else ""
    sizes = [sum(int(item["size"] or 0) for item in parts) for _, parts in bags]
    return [
        Listed(_url(files, info["name"]), size, _mark(parts), calibration)
        for (info, parts), size in zip(bags, sizes, strict=True)
    ]


@contextmanager
def local_copy(url: str) -> Iterator[Path]:
    """Yield the local path of a file or folder; download it to a temporary copy if it is remote.

    Raises
    ------
    OSError
        If the file or folder cannot be read.
    """
    files, path = _opened(url)
    if isinstance(files, LocalFileSystem):
        yield Path(path)
        return
    with tempfile.TemporaryDirectory(prefix="ema_archive_") as folder:
        copy = Path(folder) / path.rstrip("/").rpartition("/")[2]
        with _clear_errors(url):
            files.get(path, str(copy), recursive=files.isdir(path))
        yield copy


def content_digest(path: Path) -> str:
    """Return the SHA-256 of a file, or of a folder's file names and contents."""
    if not path.is_dir():
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    files = sorted(file for file in path.rglob("*") if file.is_file())
    parts = "".join(f"{file.relative_to(path)}\0{content_digest(file)}\n" for file in files)
    return hashlib.sha256(parts.encode()).hexdigest()


def full_url(source: str) -> str:
    """Return the address of a source, independent of the working directory."""
    return _url(*_opened(source))


@contextmanager
def _clear_errors(url: str) -> Iterator[None]:
    """Convert errors of a remote store to OSError with the address.

    Errors that a file is missing, a store is not supported or the local disk fails are not changed.
    """
    try:
        yield
    except (FileNotFoundError, NotADirectoryError, ImportError, NotImplementedError, ValueError):
        raise
    except Exception as error:
        is_local = get_protocol(url) in LocalFileSystem.protocol
        if is_local or (isinstance(error, OSError) and error.errno in _OF_THE_LOCAL_DISK):
            raise
        raise OSError(f"{url}: the store cannot be read: {error}") from error


def _opened(url: str) -> tuple[Any, str]:
    try:
        with _clear_errors(url):
            return fsspec.core.url_to_fs(url)
    except ImportError as error:
        raise ValueError(f"{url}: this store needs another package: {error}") from error


def _url(files: Any, path: str) -> str:
    return path if isinstance(files, LocalFileSystem) else files.unstrip_protocol(path)


def _mark(infos: list[dict[str, Any]]) -> str:
    parts = []
    for info in infos:
        marks = (str(info[name]) for name in _CHANGE_MARKS if info.get(name) is not None)
        parts.append(f"{info['size']} {next(marks, '')}")
    if len(parts) == 1:
        return parts[0]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def calibration_of(source: str, unit: UnitKey) -> AnyCalibration | CalibrationMissing:
    """Return the calibration of a unit, or the reason why there is none.

    Parameters
    ----------
    source
        Address of the calibration: from the settings of the archive, with the placeholders
        ``{actuator_id}`` and ``{serial_number}``, or the calibration in the folder of the bag.
        Empty for the shipped calibration.
    unit
        Actuator id and serial number.

    Raises
    ------
    OSError
        If an existing file cannot be read.
    """
    if not source:
        return Calibration.builtin()
    url = _url_for(source, unit)
    files, path = _opened(url)
    try:
        with _clear_errors(url):
            mark = _mark([files.info(path)])
    except FileNotFoundError:
        return NoCalibration(url)
    return _loaded(url, mark)


def changed_ns(source: str, unit: UnitKey) -> int | None:
    """Return the modification time of a unit's calibration [ns]; arguments as in `calibration_of`.

    Returns None for the shipped calibration, a missing calibration, or a store without modification
    times.

    Raises
    ------
    OSError
        If the store cannot be read.
    """
    if not source:
        return None
    url = _url_for(source, unit)
    files, path = _opened(url)
    try:
        with _clear_errors(url):
            changed = files.modified(path)
    except (FileNotFoundError, NotImplementedError):
        return None
    if changed.tzinfo is None:
        changed = changed.replace(tzinfo=UTC)
    return round(changed.timestamp() * 1e6) * 1000


def identity_of(calibration: AnyCalibration | CalibrationMissing) -> str:
    """Return the identity of a calibration, or "" for the reason why there is none."""
    return "" if isinstance(calibration, Reason) else calibration.calibration_id


def _url_for(source: str, unit: UnitKey) -> str:
    for name, value in zip(("actuator_id", "serial_number"), unit, strict=True):
        source = source.replace(f"{{{name}}}", quote(value, safe=" "))
    return source


@lru_cache(256)
def _loaded(url: str, mark: str) -> AnyCalibration | CalibrationMissing:
    with local_copy(url) as path:
        try:
            return load_calibration(path)
        except ValueError as error:
            return CalibrationUnusable(str(error).replace(str(path), url))
