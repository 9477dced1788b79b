"""Killed workers, a killed run and a full disk: nothing is lost, and nothing is there twice."""

import contextlib
import errno
import importlib
import json
import os
import signal
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ema_archive import partitions
from ema_archive.bag_task import DONE, BagResult, BagTask, UnitRows
from ema_archive.database import FILE
from ema_archive.manifest import Manifest
from ema_archive.partitions import read_unit
from ema_archive.query import answer
from ema_archive.running import RunTally, run, run_bags, run_units, scan, write_results
from ema_archive.settings import ArchiveSettings
from ema_archive.sources import Listed, calibration_of, identity_of
from ema_core.tasks import Workers

from .conftest import exactly, table_of

# Workers import it by this name from the path of this process; they do not know pytest's names.
sys.path.append(str(Path(__file__).parent))
archive_work = importlib.import_module("archive_work")

BEFORE = ArchiveSettings()
OTHER = replace(BEFORE, measured_max_age_s=2.0 * BEFORE.measured_max_age_s)
TASK = BagTask("/bags/1.mcap", "mark", "", BEFORE)


@pytest.fixture
def scanned(made_fleet, tmp_path):
    folder = tmp_path / "archive"
    with Manifest(folder, is_new=True) as manifest:
        scan(manifest, [str(made_fleet)])
    return folder


def assert_whole(archive, undisturbed):
    for name in ("estimates", "usage", "duty", "health"):
        assert exactly(archive, name) == exactly(undisturbed, name), name


@pytest.mark.slow
def test_bag_that_lost_three_workers_keeps_its_rows_and_is_done_again(ema, archive, fleet):
    bag = fleet / "unit_0" / "5.mcap"
    before = exactly(archive, "estimates")
    os.utime(bag, ns=(1, 1))
    with Manifest(archive) as manifest, Workers("processes", 1) as pool:
        scan(manifest, [])
        tally = run(manifest, pool, diagnose=archive_work.end_the_worker)
    assert (tally.bags, tally.damaged, tally.failed) == (1, 0, 1)
    assert exactly(archive, "estimates") == before
    status = json.loads(ema("archive", "status", archive, "--json").stdout)
    assert (status["due"], status["failed"]) == (1, 1)
    assert status["reasons"] == {"could not be read": 1}
    question = "select bag, reason from refused where what = 'failed'"
    _, [(url, reason)] = answer(archive, question)
    assert url == str(bag)
    assert "3 worker processes ended while they worked on it" in reason
    with Manifest(archive) as manifest, Workers("threads", 1) as pool:
        tally = run(manifest, pool)
        assert manifest.find_due(manifest.settings) == 0
    assert (tally.bags, tally.failed) == (1, 0)
    assert exactly(archive, "estimates") == before


@pytest.mark.long
def test_killed_run_goes_on_where_it_was(scanned, whole):
    """It is killed at the worst moment: rows are written, and not yet noted as done."""
    script = """
import os, signal, sys
from pathlib import Path
from ema_archive import running
from ema_archive.manifest import Manifest
from ema_core.tasks import Workers
running._MOST_GATHERED, running._GATHERED_S = 3, 600.0
commits = []
def commit(self, *given):
    commits.append(given)
    if len(commits) == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    as_before(self, *given)
as_before, Manifest.commit = Manifest.commit, commit
with Manifest(Path(sys.argv[1])) as manifest, Workers("threads", 2) as pool:
    running.run(manifest, pool)
"""
    done = subprocess.run([sys.executable, "-c", script, scanned], check=False)
    assert done.returncode == -signal.SIGKILL
    assert table_of(scanned, "estimates").num_rows >= 6
    with Manifest(scanned) as manifest, Workers("threads", 2) as pool:
        # What was written and not noted is done again, in the place of what is there.
        assert manifest.find_due(manifest.settings) == 7
        assert run(manifest, pool).mended == []
    assert_whole(scanned, whole)


@pytest.mark.slow
def test_full_disk_leaves_what_was_written(scanned, whole, monkeypatch):
    writes = 0

    def write(table, path, **options):
        nonlocal writes
        writes += 1
        if writes == 3:
            Path(path).write_bytes(b"PAR1")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return as_before(table, path, **options)

    as_before = partitions.pq.write_table
    monkeypatch.setattr(partitions.pq, "write_table", write)
    with Manifest(scanned) as manifest, Workers("threads", 2) as pool:
        with pytest.raises(OSError, match="No space left on device"):
            run(manifest, pool)
        assert not list(scanned.rglob("*.partial"))
        run(manifest, pool)
    assert_whole(scanned, whole)


@pytest.mark.long
def test_unit_that_cannot_be_followed_does_not_keep_the_others(ema, scanned):
    with Manifest(scanned) as manifest, Workers("threads", 2) as pool:
        run_bags(manifest, pool, RunTally())
    [first, *_] = sorted((scanned / "tables" / "usage").rglob("*.parquet"))
    rows, stat = pq.ParquetFile(first).read(), first.stat()
    broken = pa.array([-1.0] * rows.num_rows)
    pq.write_table(rows.set_column(rows.column_names.index("hours"), "hours", broken), first)
    with contextlib.closing(sqlite3.connect(scanned / FILE, isolation_level=None)) as db:
        # As if it had been written so.
        db.execute("DELETE FROM file WHERE size = ?", (stat.st_size,))
    result = ema("archive", "run", scanned, "--executor", "threads")
    assert result.exit_code == 3
    assert "0 bags done, 1 unit followed" in result.stdout
    assert "could not be followed: ValueError: flight_hours = -1 h" in result.stderr
    assert result.stdout.endswith("to be done: 0 bags, 1 unit\n")


class DeathError(Exception):
    """The end of a process, at a moment that a test chooses."""


def die(*_):
    raise DeathError


def done_bag(friction):
    row = {"end_ns": 1, "valid": True, "friction": friction, "bag": TASK.url}
    calibration_id = identity_of(calibration_of("", ("flap", "1")))
    unit = UnitRows("flap", "1", "model", calibration_id, [row], [], [])
    return BagResult(TASK, DONE, units=[unit])


@pytest.mark.parametrize("found", [done_bag(0.9), BagResult(TASK, DONE, "nothing in it")])
def test_bag_whose_rows_are_those_of_other_settings_is_done_again(tmp_path, monkeypatch, found):
    """A run dies with other settings, which are then taken back: no row of these stays."""
    archive = tmp_path / "archive"
    with Manifest(archive, is_new=True) as manifest:
        manifest.note([Listed(TASK.url, 1, TASK.mark, "")], 1)
        manifest.end_scan(1, ["/bags"])
        write_results(manifest, [done_bag(0.1)], BEFORE)
        assert manifest.find_due(BEFORE) == 0
        with monkeypatch.context() as patch:
            patch.setattr(manifest, "commit", die)
            with pytest.raises(DeathError):
                write_results(manifest, [found], OTHER)
    with Manifest(archive) as manifest:
        assert manifest.status(BEFORE).reasons == {"interrupted": 1}
        write_results(manifest, [done_bag(0.1)], BEFORE)
        assert manifest.find_due(BEFORE) == 0
    assert read_unit(archive, "estimates", "flap+1")["friction"].to_pylist() == [0.1]


@pytest.mark.slow
def test_unit_whose_health_is_that_of_other_settings_is_followed_again(archive, monkeypatch):
    with Manifest(archive) as manifest, Workers("threads", 2) as pool:
        before, health = manifest.settings, exactly(archive, "health")
        limits = replace(before.prognosis.limits, friction=0.2, backlash=0.2)
        manifest.settings = replace(before, prognosis=replace(before.prognosis, limits=limits))
        with monkeypatch.context() as patch:
            patch.setattr(manifest, "commit_unit", die)
            with pytest.raises(DeathError):
                run_units(manifest, pool, RunTally())
        assert exactly(archive, "health") != health
        manifest.settings = before
        assert len(manifest.units_due(before)) == 1
        run_units(manifest, pool, RunTally())
        assert exactly(archive, "health") == health


@pytest.fixture
def held(scanned):
    """Hold the lock of those that write, as a command does in the middle of a change."""
    with contextlib.closing(sqlite3.connect(scanned / FILE, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        yield scanned
        other.execute("ROLLBACK")


def without_waiting(manifest):
    manifest._db.execute("PRAGMA busy_timeout = 0")
    return manifest


def test_only_one_command_changes_an_archive(ema, scanned):
    with Manifest(scanned):
        result = ema("archive", "run", scanned)
        assert result.exit_code == 1
        assert "is being changed by another command" in result.stderr


def test_status_does_not_wait_for_one_that_writes(held):
    with Manifest(held, writes=False) as manifest:
        assert without_waiting(manifest).status(ArchiveSettings()).bags == 10


def test_database_that_another_program_holds_is_named(held):
    said = f"{FILE} cannot be written: database is locked"
    with Manifest(held) as manifest, pytest.raises(OSError, match=said):
        without_waiting(manifest).settings = ArchiveSettings()


def test_damage_that_a_read_finds_is_named(scanned):
    with contextlib.closing(sqlite3.connect(scanned / FILE)) as other:
        other.execute("DROP TABLE bag")
    said = f"{scanned / FILE} cannot be used: no such table: bag"
    with pytest.raises(OSError, match=said), Manifest(scanned) as manifest:
        manifest.status(ArchiveSettings())
