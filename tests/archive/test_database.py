"""The database of an archive that another process holds, or that is damaged."""

import contextlib
import sqlite3

import pytest

from ema_archive.database import FILE
from ema_archive.manifest import Manifest
from ema_archive.service_record import ServiceRecord
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


def test_a_database_of_earlier_software_is_made_one_of_this(tmp_path):
    archive = tmp_path / "archive"
    with Manifest(archive, is_new=True):
        pass
    with contextlib.closing(sqlite3.connect(archive / FILE)) as db:
        columns = db.execute("SELECT name FROM pragma_table_info('unit')").fetchall()
        db.execute("ALTER TABLE unit DROP COLUMN record")
        db.execute("DROP INDEX bag_of_content")
        db.execute(
            "INSERT INTO unit (unit, actuator_id, serial_number, model, is_due) "
            "VALUES ('a+1', 'a', '1', 'm', 1)"
        )
        db.execute("PRAGMA user_version = 1")
        db.commit()
    for writes in (False, True):
        with Manifest(archive, writes=writes) as manifest:
            [known] = manifest.units()
            assert known.record == ServiceRecord()
    with contextlib.closing(sqlite3.connect(archive / FILE)) as db:
        assert db.execute("SELECT name FROM pragma_table_info('unit')").fetchall() == columns
