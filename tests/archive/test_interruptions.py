"""Killed workers, a killed run and a full disk: nothing is lost, and nothing is there twice."""

import errno
import importlib
import json
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ema_archive import partitions
from ema_archive.manifest import Manifest
from ema_archive.running import RunTally, run, run_bags, scan
from ema_core.tasks import Workers

from .conftest import exactly, table_of

# Workers import it by this name from the path of this process; they do not know pytest's names.
sys.path.append(str(Path(__file__).parent))
archive_work = importlib.import_module("archive_work")


@pytest.fixture
def scanned(made_fleet, tmp_path):
    folder = tmp_path / "archive"
    with Manifest(folder, is_new=True) as manifest:
        scan(manifest, [str(made_fleet)])
    return folder


@pytest.fixture(scope="module")
def undisturbed(made_fleet, tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed") / "archive"
    with Manifest(folder, is_new=True) as manifest, Workers("threads", 2) as pool:
        scan(manifest, [str(made_fleet)])
        run(manifest, pool)
    return folder


def assert_whole(archive, undisturbed):
    for name in ("estimates", "usage", "health"):
        assert exactly(archive, name) == exactly(undisturbed, name), name
    bags = Counter(table_of(archive, "estimates")["bag"].to_pylist())
    assert len(bags) == 10
    assert bags.most_common(1)[0][1] == max(
        Counter(table_of(undisturbed, "estimates")["bag"].to_pylist()).values()
    )


@pytest.mark.slow
def test_bag_that_lost_three_workers_keeps_its_rows_and_is_done_again(ema, fleet, tmp_path):
    folder, bag = tmp_path / "archive", fleet / "unit_0" / "5.mcap"
    with Manifest(folder, is_new=True) as manifest, Workers("threads", 2) as pool:
        scan(manifest, [str(bag.parent)])
        run(manifest, pool)
    whole = exactly(folder, "estimates")
    os.utime(bag, ns=(1, 1))
    with Manifest(folder) as manifest, Workers("processes", 1) as pool:
        scan(manifest, [])
        tally = run(manifest, pool, diagnose=archive_work.end_the_worker)
    assert (tally.bags, tally.damaged, tally.failed) == (1, 0, 1)
    assert exactly(folder, "estimates") == whole
    status = json.loads(ema("archive", "status", folder, "--json").stdout)
    assert (status["due"], status["failed"]) == (1, 1)
    assert status["reasons"] == {"could not be read": 1}
    question = "select bag, reason from refused where what = 'failed'"
    [row] = json.loads(ema("archive", "query", folder, question, "--json").stdout)
    assert row["bag"] == str(bag)
    assert "3 worker processes ended while they worked on it" in row["reason"]
    with Manifest(folder) as manifest, Workers("threads", 1) as pool:
        tally = run(manifest, pool)
        assert manifest.find_due(manifest.settings) == 0
    assert (tally.bags, tally.failed) == (1, 0)
    assert exactly(folder, "estimates") == whole


@pytest.mark.long
def test_killed_run_goes_on_where_it_was(scanned, undisturbed, monkeypatch):
    """It is killed at the worst moment: rows are written, and not yet noted as done."""
    script = """
import os, signal, sys
from pathlib import Path
from ema_archive import running
from ema_archive.manifest import Manifest
from ema_core.tasks import Workers
running._MOST_GATHERED = 3
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
        run(manifest, pool)
    assert_whole(scanned, undisturbed)


@pytest.mark.slow
def test_full_disk_leaves_what_was_written(scanned, undisturbed, monkeypatch):
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
    assert_whole(scanned, undisturbed)


@pytest.mark.slow
def test_only_one_command_changes_an_archive(ema, scanned):
    with Manifest(scanned):
        result = ema("archive", "run", scanned)
        assert result.exit_code == 1
        assert "is being changed by another command" in result.stderr
        assert ema("archive", "status", scanned).exit_code == 0


@pytest.mark.long
def test_unit_that_cannot_be_followed_does_not_keep_the_others(ema, scanned):
    with Manifest(scanned) as manifest, Workers("threads", 2) as pool:
        run_bags(manifest, pool, RunTally())
    [first, *_] = sorted((scanned / "tables" / "usage").rglob("*.parquet"))
    rows = pq.ParquetFile(first).read()
    broken = pa.array([-1.0] * rows.num_rows)
    pq.write_table(rows.set_column(rows.column_names.index("hours"), "hours", broken), first)
    result = ema("archive", "run", scanned, "--executor", "threads")
    assert result.exit_code == 3
    assert "0 bags done, 1 unit followed" in result.stdout
    assert "could not be followed: ValueError: flight_hours = -1 h" in result.stderr
    assert result.stdout.endswith("to be done: 0 bags, 1 unit\n")
