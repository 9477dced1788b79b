"""An archive is made of bags: what is missing or damaged of it is noticed, and made again."""

import shutil
from pathlib import Path

import pytest

from ema_archive.database import FILE
from ema_archive.partitions import TABLES

from ..archive.conftest import _threads_as_before, archive, exactly, fleet, made_archive, made_fleet
from ..commands import ema

__all__ = ["_threads_as_before", "archive", "fleet", "made_archive", "made_fleet"]

pytestmark = pytest.mark.slow
HERE = ("--executor", "threads", "--workers", "1")


def remove(archive: Path) -> None:
    shutil.rmtree(archive / TABLES / "estimates")


def truncate(archive: Path) -> None:
    path = next((archive / TABLES / "estimates").rglob("part.parquet"))
    path.write_bytes(path.read_bytes()[:-100])


def alter(archive: Path) -> None:
    path = next((archive / TABLES / "health").rglob("part.parquet"))
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("damage", [remove, truncate, alter])
def test_damaged_tables_are_made_anew(archive: Path, damage):
    whole = {name: exactly(archive, name) for name in ("estimates", "health")}
    damage(archive)
    assert "of the tables missing or damaged" in ema("archive", "status", archive).stdout
    result = ema("archive", "run", archive, *HERE)
    assert "made anew" in result.stderr
    assert "all is up to date" in result.stdout
    assert {name: exactly(archive, name) for name in whole} == whole
    assert ema("archive", "run", archive, *HERE).stderr == ""


def test_what_bags_that_are_gone_said_is_named(archive: Path, fleet: Path):
    for bag in fleet.rglob("*.mcap"):
        bag.unlink()
    assert ema("archive", "scan", archive).exit_code == 0
    remove(archive)
    result = ema("archive", "run", archive, *HERE)
    assert "10 bags of these tables are missing, such as" in result.stderr
    assert "bring them back" in result.stderr


@pytest.mark.parametrize("content", [b"", b"SQLite format 3\0" + b"\xd8" * 5000])
def test_damaged_database_is_an_error_with_its_remedy(archive: Path, content: bytes):
    for suffix in ("-wal", "-shm"):
        (archive / f"{FILE}{suffix}").unlink(missing_ok=True)
    (archive / FILE).write_bytes(content)
    result = ema("archive", "run", archive)
    assert result.exit_code == 1
    assert FILE in result.stderr
    assert "scan the bags to a new archive" in result.stderr
