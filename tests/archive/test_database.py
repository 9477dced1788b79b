"""The database of an archive that another process holds, or that is damaged."""

import contextlib
import sqlite3

import pytest

from ema_archive.database import FILE
from ema_archive.manifest import Manifest
from ema_archive.settings import ArchiveSettings


@pytest.fixture
def archive(tmp_path):
    folder = tmp_path / "archive"
    with Manifest(folder, is_new=True):
        pass
    return folder


@contextlib.contextmanager
def held(archive):
    """Hold the lock of those that write, as a command does in the middle of a change."""
    with contextlib.closing(sqlite3.connect(archive / FILE, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        yield
        other.execute("ROLLBACK")


def without_waiting(manifest):
    manifest._db.execute("PRAGMA busy_timeout = 0")
    return manifest


def test_status_does_not_wait_for_one_that_writes(archive):
    with held(archive), Manifest(archive, writes=False) as manifest:
        assert without_waiting(manifest).status(ArchiveSettings()).bags == 0


def test_database_that_another_program_holds_is_named(archive):
    with (
        held(archive),
        Manifest(archive) as manifest,
        pytest.raises(OSError, match=f"{FILE} cannot be written: database is locked"),
    ):
        without_waiting(manifest).settings = ArchiveSettings()


def test_damage_that_a_read_finds_is_named(archive):
    with contextlib.closing(sqlite3.connect(archive / FILE)) as other:
        other.execute("DROP TABLE bag")
    said = f"{archive / FILE} cannot be used: no such table: bag"
    with pytest.raises(OSError, match=said), Manifest(archive) as manifest:
        manifest.status(ArchiveSettings())
