# SPDX-License-Identifier: Apache-2.0
"""Killed workers, a killed run and a full disk neither lose nor duplicate results."""

import contextlib
import importlib
import json
import os
import random
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import duckdb
import pytest

from ema_archive import commits, running, store
from ema_archive.bag_task import DONE, BagResult, BagTask, UnitRows, unit_name
from ema_archive.commits import commit_bags
from ema_archive.manifest import Manifest
from ema_archive.query import answer
from ema_archive.running import RunTally, run, run_bags, run_units, scan
from ema_archive.settings import ArchiveSettings
from ema_archive.sources import Listed, calibration_of, identity_of
from ema_archive.store import FILE
from ema_core.tasks import Workers

from .conftest import exactly, rows_of_unit, table_of
from .drawn_archive import UNIT, make_stubs

# Workers import the module by this name from ``sys.path``; they do not know the names of pytest.
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
def test_bag_whose_workers_died_three_times_keeps_its_rows_and_is_processed_again(
    ema, archive, fleet
):
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
@pytest.mark.parametrize(("when", "left"), [("before", 7), ("after", 4)])
def test_killed_run_resumes_after_the_last_commit(scanned, whole, when, left):
    """The process is killed while it writes rows, or after it has committed them."""
    script = """
import os, signal, sys
from pathlib import Path
from ema_archive import commits, running
from ema_archive.manifest import Manifest
from ema_archive.store import Store
from ema_core.tasks import Workers
running._MOST_BATCHED, running._BATCH_S = 3, 600.0
archive, when = Path(sys.argv[1]), sys.argv[2]
calls = []
def insert(db, table, rows):
    as_before(db, table, rows)
    if when == "before" and table == "estimates":
        end_at_the_second()
def note(self):
    if when == "after":
        end_at_the_second()
    noted(self)
def end_at_the_second():
    calls.append(1)
    if len(calls) == 2:
        os.kill(os.getpid(), signal.SIGKILL)
as_before, commits.insert = commits.insert, insert
noted, Store._note = Store._note, note
with Manifest(archive) as manifest, Workers("threads", 2) as pool:
    running.run(manifest, pool)
"""
    done = subprocess.run([sys.executable, "-c", script, scanned, when], check=False)
    assert done.returncode == -signal.SIGKILL
    assert table_of(scanned, "estimates").num_rows >= 10 - left
    with Manifest(scanned) as manifest, Workers("threads", 2) as pool:
        assert manifest.find_due(manifest.settings) == left
        assert run(manifest, pool).mended == []
    assert_whole(scanned, whole)


KILLS = 6


@pytest.mark.long
def test_archive_killed_at_random_times_ends_equal_to_an_undisturbed_one(tmp_path):
    """The tests are drawn and not identified, so that commits take most of the time."""
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "tests.archive.drawn_archive"]
    bags, rng = tmp_path / "bags", random.Random(7)
    make_stubs(bags, 20)
    killed, undisturbed = tmp_path / "killed", tmp_path / "undisturbed"
    for archive in (killed, undisturbed):
        with Manifest(archive, is_new=True) as manifest:
            scan(manifest, [str(bags)])
    deaths, done = 0, 0
    while deaths < KILLS:
        with subprocess.Popen([*command, killed], cwd=root, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(rng.uniform(0.0, 0.4))
            process.kill()
        deaths += 1
        with Manifest(killed, writes=False) as manifest:
            status = manifest.status(manifest.settings)
            rows = manifest.rows_of_unit("estimates", unit_name(*UNIT)).num_rows
        # No committed bag is lost, and the rows of each bag agree with its state.
        assert status.bags - status.due == status.windows == rows >= done
        assert status.damaged_tables == []
        done = rows
    for archive in (killed, undisturbed):
        subprocess.run([*command, archive], cwd=root, check=True, stdout=subprocess.DEVNULL)
    for name in ("estimates", "health", "units"):
        assert exactly(killed, name) == exactly(undisturbed, name), name


@contextlib.contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Limit the size of files to ``size`` bytes; larger writes fail as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.slow
@pytest.mark.parametrize(("size", "left"), [(8192, 7), ("file", 4)], ids=["log", "file"])
def test_full_disk_keeps_committed_results(scanned, whole, monkeypatch, size, left):
    """The disk is full while the log of a commit, or the file of the store, is written."""
    sizes = []

    def commit(store, results, settings):
        sizes.append((scanned / FILE).stat().st_size if size == "file" else size)
        limit = largest_file(sizes[-1]) if len(sizes) == 2 else contextlib.nullcontext()
        with limit:
            commit_bags(store, results, settings)

    monkeypatch.setattr(running, "commit_bags", commit)
    monkeypatch.setattr(running, "_MOST_BATCHED", 3)
    with Manifest(scanned) as manifest, Workers("threads", 2) as pool:
        with pytest.raises(OSError, match=r"cannot be written: .*File too large"):
            run(manifest, pool)
        # Bags that workers had begun were finished.
        assert manifest.find_due(manifest.settings) <= left
        assert manifest.damaged_tables() == []
        run(manifest, pool)
    assert_whole(scanned, whole)


@pytest.mark.long
def test_unit_that_cannot_be_processed_does_not_stop_the_others(ema, scanned):
    with Manifest(scanned) as manifest, Workers("threads", 2) as pool:
        run_bags(manifest, pool, RunTally())
    with Manifest(scanned) as manifest, manifest.changing() as db:
        db.execute("UPDATE usage SET hours = -1 WHERE unit = (SELECT min(unit) FROM usage)")
    result = ema("archive", "run", scanned, "--executor", "threads")
    assert result.exit_code == 3
    assert "0 bags and 1 unit processed" in result.stdout
    assert "could not be processed: ValueError: flight_hours = -1 h" in result.stderr
    assert result.stdout.endswith("to process: 0 bags, 1 unit\n")


class DeathError(Exception):
    """Raised at a moment chosen by a test, in place of the end of the process."""


def die(*_):
    raise DeathError


def done_bag(friction):
    row = {"end_ns": 1, "valid": True, "friction": friction, "bag": TASK.url}
    calibration_id = identity_of(calibration_of("", ("flap", "1")))
    unit = UnitRows("flap", "1", "model", calibration_id, [row], [], [])
    return BagResult(TASK, DONE, units=[unit])


@pytest.mark.parametrize("result", [done_bag(0.9), BagResult(TASK, DONE, "nothing in it")])
def test_bag_with_rows_of_other_settings_is_processed_again(tmp_path, monkeypatch, result):
    """A run with other settings dies. After the settings are restored, none of its rows remain."""
    archive = tmp_path / "archive"
    with Manifest(archive, is_new=True) as manifest:
        manifest.note([Listed(TASK.url, 1, TASK.mark, "")], 1)
        manifest.end_scan(1, ["/bags"])
        commit_bags(manifest, [done_bag(0.1)], BEFORE)
        assert manifest.find_due(BEFORE) == 0
        with monkeypatch.context() as patch:
            patch.setattr(manifest, "_note", die)
            with pytest.raises(DeathError):
                commit_bags(manifest, [result], OTHER)
    with Manifest(archive) as manifest:
        assert manifest.status(BEFORE).reasons == {"other settings": 1}
        assert manifest.find_due(OTHER) == 0
        commit_bags(manifest, [done_bag(0.1)], BEFORE)
        assert manifest.find_due(BEFORE) == 0
    rows = rows_of_unit(archive, "estimates", "flap+1")
    assert rows["friction"].to_pylist() == [0.1]


def test_change_that_fails_leaves_the_archive_unchanged(tmp_path, monkeypatch):
    archive = tmp_path / "archive"
    with Manifest(archive, is_new=True) as manifest:
        manifest.note([Listed(TASK.url, 1, TASK.mark, "")], 1)
        manifest.end_scan(1, ["/bags"])
        commit_bags(manifest, [done_bag(0.1)], BEFORE)
        before = {name: exactly(archive, name) for name in ("estimates", "bags", "manifest.part")}
        monkeypatch.setattr(commits, "_add_rows", die)
        with pytest.raises(DeathError):
            commit_bags(manifest, [done_bag(0.9)], OTHER)
        assert {name: exactly(archive, name) for name in before} == before


@pytest.mark.slow
def test_unit_with_health_of_other_settings_is_processed_again(archive, monkeypatch):
    with Manifest(archive) as manifest, Workers("threads", 2) as pool:
        before, health = manifest.settings, exactly(archive, "health")
        limits = replace(before.prognosis.limits, friction=0.2, backlash=0.2)
        manifest.settings = replace(before, prognosis=replace(before.prognosis, limits=limits))
        with monkeypatch.context() as patch:
            patch.setattr(manifest, "_note", die)
            with pytest.raises(DeathError):
                run_units(manifest, pool, RunTally())
        assert exactly(archive, "health") != health
        manifest.settings = before
        assert len(manifest.units_due(before)) == 2
        run_units(manifest, pool, RunTally())
        assert exactly(archive, "health") == health


@pytest.fixture
def held(scanned):
    """Hold the store open in another process, as a command does during a change."""
    script = f"import duckdb; db = duckdb.connect({str(scanned / FILE)!r}); print(1); input()"
    command = [sys.executable, "-u", "-c", script]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield scanned
        process.communicate(b"\n")


def test_only_one_command_changes_an_archive(ema, scanned):
    with Manifest(scanned):
        result = ema("archive", "run", scanned)
        assert result.exit_code == 1
        assert "is being changed by another command" in result.stderr


def test_status_and_query_do_not_wait_for_a_run(ema, scanned):
    """A run releases the store between its changes, which are short."""
    script = f"""
from pathlib import Path
from ema_archive.manifest import Manifest
with Manifest(Path({str(scanned)!r})) as manifest:
    manifest.settings = manifest.settings
    print(1)
    input()
"""
    command = [sys.executable, "-u", "-c", script]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        assert "10 bags" in ema("archive", "status", scanned).stdout
        assert answer(scanned, "select count(*) from bags")[1] == [(10,)]
        process.communicate(b"\n")


def test_store_in_use_by_another_program_is_named(held, monkeypatch):
    monkeypatch.setattr(store, "_READER_WAITS_S", 0.0)
    monkeypatch.setattr(store, "_WRITER_WAITS_S", 0.0)
    printed = f"{FILE} is in use by another program"
    for writes in (False, True):
        with pytest.raises(OSError, match=printed):
            Manifest(held, writes=writes)


def test_change_waits_for_readers(scanned):
    with Manifest(scanned) as manifest, duckdb.connect(scanned / FILE, read_only=True) as reader:
        timer = threading.Timer(0.5, reader.close)
        timer.start()
        manifest.settings = OTHER
        timer.join()
        assert manifest.settings == OTHER


def test_damage_detected_while_reading_is_named(scanned):
    with duckdb.connect(scanned / FILE) as db:
        db.execute("DROP TABLE manifest.bag CASCADE")
    printed = f"{scanned / FILE} cannot be used: Catalog Error: Table with name bag does not exist"
    with pytest.raises(OSError, match=printed), Manifest(scanned) as manifest:
        manifest.find_due(ArchiveSettings())
