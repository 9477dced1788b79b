# SPDX-License-Identifier: Apache-2.0
"""Missing or damaged parts of an archive are detected, and recomputed from the bags."""

import random
from pathlib import Path

import duckdb
import pytest

from ema_archive.store import FILE, Store

from ..archive.conftest import (
    _threads_as_before,
    archive,
    damage_rows,
    exactly,
    fleet,
    made_archive,
    made_fleet,
)
from ..commands import ema

__all__ = ["_threads_as_before", "archive", "fleet", "made_archive", "made_fleet"]

pytestmark = pytest.mark.slow
HERE = ("--executor", "threads", "--workers", "1")


@pytest.mark.parametrize("table", ["estimates", "duty", "health", "units", "manifest.test"])
def test_damaged_tables_are_recomputed(archive: Path, table: str):
    whole = {name: exactly(archive, name) for name in ("estimates", "duty", "health")}
    damage_rows(archive, table)
    assert "1 table damaged" in ema("archive", "status", archive).stdout
    result = ema("archive", "run", archive, *HERE)
    assert f"1 table damaged, {table}: recomputed" in result.stderr
    assert "everything is up to date" in result.stdout
    assert {name: exactly(archive, name) for name in whole} == whole
    assert ema("archive", "run", archive, *HERE).stderr == ""


def test_missing_bags_of_damaged_tables_are_named(archive: Path, fleet: Path):
    for bag in fleet.rglob("*.mcap"):
        bag.unlink()
    assert ema("archive", "scan", archive).exit_code == 0
    damage_rows(archive, "estimates")
    result = ema("archive", "run", archive, *HERE)
    assert "10 bags of these tables are missing, such as" in result.stderr
    assert "restore them" in result.stderr


@pytest.mark.parametrize("content", [b"", b"not a database" * 1000])
def test_damaged_store_is_an_error_with_a_remedy(archive: Path, content: bytes):
    (archive / FILE).write_bytes(content)
    for command in ("run", "status"):
        result = ema("archive", command, archive)
        assert result.exit_code == 1
        assert FILE in result.stderr
        assert "scan the bags into a new archive" in result.stderr


def test_flipped_bits_and_truncation_never_change_rows_unnoticed(archive: Path):
    """Each damage is reported, or lies in a part of the file that is not read."""
    path = archive / FILE
    whole, rng = path.read_bytes(), random.Random(3)
    with Store(archive, writes=False) as store, store.reading() as db:
        tables = [f"{schema}.{name}" for schema, name in db.execute(_TABLES).fetchall()]
    rows = contents(path, tables)
    noticed = 0
    for _ in range(60):
        content = bytearray(whole)
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        path.write_bytes(content)
        noticed += is_noticed(archive, tables, rows)
    assert noticed > 10
    for share in (0.2, 0.5, 0.9, 0.999):
        path.write_bytes(whole[: round(share * len(whole))])
        assert is_noticed(archive, tables, rows)


_TABLES = "SELECT schema_name, table_name FROM duckdb_tables()"


def contents(path: Path, tables: list[str]) -> list[str]:
    with duckdb.connect(path, read_only=True) as db:
        queries = (f"SELECT * FROM {name} ORDER BY ALL" for name in tables)
        return [repr(db.execute(query).fetchall()) for query in queries]


def is_noticed(archive: Path, tables: list[str], rows: list[str]) -> bool:
    """Return whether the status reports damage; if not, check that all rows are unchanged."""
    status = ema("archive", "status", archive)
    if status.exit_code == 0 and "damaged" not in status.stdout:
        assert contents(archive / FILE, tables) == rows
        return False
    return True
