# SPDX-License-Identifier: Apache-2.0
"""Damaged tables and bags: missing data never lead to an answer or to the level OK."""

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from ema_archive.manifest import Manifest
from ema_archive.mending import mend
from ema_archive.query import answer
from ema_archive.running import run, scan
from ema_archive.store import FILE, TABLES
from ema_core.tasks import Workers

from .conftest import damage_rows, exactly

HERE = ("--executor", "threads", "--workers", "1")
LEVELS = "select serial_number, health, last_health, reason from worst_first order by 1"


def halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(path: Path) -> None:
    content, random_places = bytearray(path.read_bytes()), random.Random(1)
    for _ in range(20):
        content[random_places.randrange(len(content))] ^= 255
    path.write_bytes(bytes(content))


def empty(path: Path) -> None:
    path.write_bytes(b"")


def commands(archive: Path) -> list[tuple[Any, ...]]:
    """Return the commands that read results from an archive."""
    return [
        ("archive", "query", archive, "select * from worst_first"),
        ("archive", "export", archive, "units", "-o", archive.parent / "units.csv"),
        ("report", "--fleet", archive, "-o", archive.parent / "fleet.html"),
    ]


@pytest.mark.slow
def test_any_damaged_table_is_named_and_recomputed(ema, archive: Path):
    before = {name: exactly(archive, name) for name in ("estimates", "health")}
    levels = answer(archive, LEVELS)
    with Manifest(archive, writes=False) as manifest, manifest.reading() as db:
        # An empty table has no rows to damage.
        names = [name for name in TABLES if db.execute(f"SELECT * FROM {name} LIMIT 1").fetchall()]
    assert len(names) == len(TABLES) - 1
    for name in names:
        damage_rows(archive, name)
        printed = f"1 table damaged, {name}: run `ema archive run"
        for command in commands(archive):
            result = ema(*command)
            assert (result.exit_code, printed in result.stderr) == (1, True), (name, result.output)
        status = ema("archive", "status", archive)
        assert (status.exit_code, "1 table damaged" in status.stdout) == (0, True), status.output
        assert json.loads(ema("archive", "status", archive, "--json").stdout)["damaged_tables"] == [
            name
        ]
        result = ema("archive", "run", archive, *HERE)
        assert (result.exit_code, "recomputed" in result.stderr) == (0, True), result.output
        assert "everything is up to date" in result.stdout
        assert answer(archive, LEVELS) == levels
    assert {name: exactly(archive, name) for name in before} == before


def test_only_unreadable_rows_are_recomputed(tmp_path: Path):
    """Only the bags of the damaged row group are due again; the other groups keep their rows."""
    archive, groups = tmp_path / "archive", 3
    bags = [f"/bags/{number:06d}.mcap" for number in range(groups * 122_880)]
    with Manifest(archive, is_new=True) as manifest:
        with manifest.changing() as db:
            db.register("_rows", pa.table({"bag": bags}))
            db.execute(
                "INSERT INTO manifest.bag BY NAME SELECT bag, 0 AS bytes, '' AS mark, "
                "'' AS calibration_url, 1 AS scan, true AS is_there, 'done' AS state FROM _rows"
            )
            db.execute("INSERT INTO manifest.part SELECT bag, 'u', 'm', '', 0, 1, 0, 0 FROM _rows")
            db.execute("INSERT INTO estimates BY NAME SELECT bag, random() AS friction FROM _rows")
        damage_rows(archive, "estimates")
        [words] = mend(manifest)
        assert words == "1 table damaged, estimates: recomputed"
        with manifest.reading() as db:
            lost = db.execute("SELECT bag FROM manifest.bag WHERE state = 'lost'").fetchall()
            [(kept,)] = db.execute("SELECT count(*) FROM estimates").fetchall()
        assert manifest.damaged_tables() == []
    assert len(lost) == 122_880
    assert kept == (groups - 1) * 122_880


@pytest.mark.parametrize("damage", [Path.unlink, empty, halve, flip])
def test_damaged_store_is_named_with_the_remedy(ema, archive: Path, damage):
    damage(archive / FILE)
    for command in (
        *commands(archive),
        ("archive", "status", archive),
        ("archive", "run", archive),
    ):
        result = ema(*command)
        assert result.exit_code == 1, result.output
        assert str(archive) in result.stderr
        assert FILE in result.stderr
        if damage is not Path.unlink:
            assert "scan the bags into a new archive" in result.stderr


def replace_by(make: Callable[[Path], Any], name: str = FILE) -> Callable[[Path], None]:
    def replace(archive: Path) -> None:
        (archive / name).unlink(missing_ok=True)
        make(archive / name)

    return replace


@pytest.mark.parametrize(
    "damage",
    [
        replace_by(lambda path: path.write_text("no database\n" * 1000, encoding="utf-8")),
        replace_by(Path.mkdir),
        replace_by(os.mkfifo),
        replace_by(lambda path: path.symlink_to("/dev/zero")),
        replace_by(Path.mkdir, f"{FILE}.wal"),
        replace_by(os.mkfifo, f"{FILE}.wal"),
        replace_by(Path.mkdir, ".lock"),
        replace_by(os.mkfifo, ".lock"),
    ],
)
def test_store_of_another_file_type_is_refused_at_once(ema, tmp_path: Path, damage):
    archive = tmp_path / "archive"
    bring_up_to_date(archive)
    damage(archive)
    before_s = time.monotonic()
    for command in ("status", "query", "run", "scan"):
        result = ema("archive", command, archive, *["from units"] * (command == "query"))
        assert result.exit_code == 1, result.output
        assert str(archive) in result.stderr
        assert "scan the bags into a new archive" in result.stderr
    assert time.monotonic() < before_s + 20.0


def test_store_of_another_archive_is_refused(ema, tmp_path: Path):
    """The foreign store would answer for the units of other bags, or return no rows."""
    archive, foreign, copy = (tmp_path / name for name in ("archive", "foreign", "copy"))
    bring_up_to_date(archive)
    bring_up_to_date(foreign)
    shutil.copytree(archive, copy)
    shutil.copy(foreign / FILE, archive / FILE)
    for command in ("status", "query", "run", "scan"):
        result = ema("archive", command, archive, *["from units"] * (command == "query"))
        assert result.exit_code == 1, result.output
        assert f"{archive / FILE} belongs to another archive" in result.stderr
        assert "restore its own file" in result.stderr
    # The archive accepts its own file, and so does a copy of the folder.
    shutil.copy(copy / FILE, archive / FILE)
    for folder in (archive, copy):
        assert ema("archive", "status", folder).exit_code == 0


def test_store_without_its_lock_file_is_read(ema, archive: Path):
    (archive / ".lock").unlink()
    assert ema("archive", "status", archive).exit_code == 0
    assert len(answer(archive, LEVELS)[1]) == 2


def test_foreign_write_ahead_log_is_ignored(ema, archive: Path):
    (archive / f"{FILE}.wal").write_text("no changes\n" * 100, encoding="utf-8")
    assert len(answer(archive, LEVELS)[1]) == 2
    assert ema("archive", "run", archive, *HERE).exit_code == 0
    assert len(answer(archive, LEVELS)[1]) == 2


def test_archive_of_an_earlier_version_is_refused(ema, tmp_path: Path):
    archive = tmp_path / "archive"
    archive.mkdir()
    (archive / "archive.sqlite").write_bytes(b"SQLite format 3")
    for command in (("scan", archive, tmp_path), ("run", archive), ("status", archive)):
        result = ema("archive", *command)
        assert result.exit_code == 1
        assert "has a version before 15, expected 15" in result.stderr
        assert "scan the bags into a new archive" in result.stderr
    older = tmp_path / "other"
    with Manifest(older, is_new=True) as manifest, manifest.changing() as db:
        db.execute("UPDATE manifest.archive SET version = 11")
    result = ema("archive", "status", older)
    assert f"{older / FILE} has version 11, expected 15: scan the bags into a new" in result.stderr


def bring_up_to_date(archive: Path, *sources: Path) -> None:
    with Manifest(archive, is_new=True) as manifest, Workers("threads", 1) as pool:
        scan(manifest, [str(source) for source in sources])
        run(manifest, pool)


@pytest.fixture
def two_tests(made_fleet: Path, tmp_path: Path) -> Path:
    """Return a folder with the first and the last bag of a unit, which fails in the last test."""
    folder = tmp_path / "bags"
    folder.mkdir()
    for name in ("calibration.yaml", "9.mcap", "5.mcap"):
        shutil.copy(made_fleet / "unit_0" / name, folder)
    return folder


@pytest.mark.slow
def test_unit_whose_newest_bag_is_truncated_is_not_ok(ema, two_tests: Path, tmp_path: Path):
    whole, archive, cut = tmp_path / "whole", tmp_path / "archive", two_tests / "5.mcap"
    bring_up_to_date(whole, two_tests)
    failed = [row[1] for row in answer(whole, LEVELS)[1]]
    assert failed != ["OK"]
    content = cut.read_bytes()
    cut.write_bytes(content[: len(content) // 4])

    ema("archive", "scan", archive, two_tests)
    result = ema("archive", "run", archive, *HERE)
    assert result.exit_code == 3
    assert "0 damaged, 1 read in part, 0 unreadable" in result.stdout
    _, [(_, level, last, reason)] = answer(archive, LEVELS)
    assert (level, last) == ("STALE", "OK")
    assert reason.startswith(f"later tests may be lost: {cut} can be read only in part: it is")
    status = ema("archive", "status", archive).stdout
    assert "1 bag can be read only in part: later tests may be lost" in status
    assert json.loads(ema("archive", "status", archive, "--json").stdout)["incomplete"] == 1
    _, [(bag, what)] = answer(archive, "select bag, what from refused where number is null")
    assert (bag, what) == (str(cut), "incomplete")
    page = tmp_path / "fleet.html"
    assert ema("report", "--fleet", archive, "-o", page).exit_code == 0
    assert "Of 2 bags: 1 can be read only in part" in page.read_text()
    # The bag is processed again only after it has changed; then its test counts.
    assert "everything is up to date" in ema("archive", "run", archive, *HERE).stdout
    cut.write_bytes(content)
    bring_up_to_date(archive)
    assert [row[1] for row in answer(archive, LEVELS)[1]] == failed


@pytest.mark.slow
def test_bag_that_is_damaged_later_keeps_its_test(two_tests: Path, tmp_path: Path):
    archive, newest = tmp_path / "archive", two_tests / "5.mcap"
    bring_up_to_date(archive, two_tests)
    _, [(_, level, _, reason)] = answer(archive, LEVELS)
    before = exactly(archive, "health")
    empty(newest)
    bring_up_to_date(archive)
    assert exactly(archive, "health") == before
    _, [(_, after, _, words)] = answer(archive, LEVELS)
    assert after == level != "OK"
    assert words.startswith(f"later tests may be lost: {newest}")
    assert words.endswith(reason)


@pytest.mark.slow
def test_later_test_of_an_intact_bag_clears_the_doubt_of_a_truncated_one(
    two_tests: Path, tmp_path: Path
):
    archive, first = tmp_path / "archive", two_tests / "9.mcap"
    content = first.read_bytes()
    first.write_bytes(content[: len(content) * 9 // 10])
    bring_up_to_date(archive, two_tests)
    _, [(_, level, _, reason)] = answer(archive, LEVELS)
    assert level != "STALE"
    assert "lost" not in reason
    _, [(states,)] = answer(archive, "select list(state order by state) from bags")
    assert states == ["done", "incomplete"]


@contextlib.contextmanager
def made_read_only(folder: Path) -> Iterator[Path]:
    """Make a folder and its content read-only, as on a read-only medium."""
    modes = [(path, path.stat().st_mode) for path in (folder, *folder.rglob("*"))]
    for path, mode in modes:
        path.chmod(mode & ~0o222)
    is_root = os.geteuid() == 0
    if is_root and subprocess.run(["chattr", "-R", "+i", folder], check=False).returncode:
        pytest.skip("the file system cannot refuse that root writes")
    try:
        yield folder
    finally:
        if is_root:
            subprocess.run(["chattr", "-R", "-i", folder], check=True)
        for path, mode in modes:
            path.chmod(mode)


@pytest.mark.slow
def test_read_only_archive_can_be_read(ema, archive: Path, tmp_path: Path):
    with made_read_only(archive):
        assert "everything is up to date" in ema("archive", "status", archive).stdout
        result = ema("archive", "query", archive, LEVELS)
        assert (result.exit_code, len(result.stdout.splitlines())) == (0, 3), result.output
        assert ema("report", "--fleet", archive, "-o", tmp_path / "fleet.html").exit_code == 0
        assert ema("verify", archive).exit_code == 0
        result = ema("archive", "run", archive)
        assert result.exit_code == 1
        assert str(archive) in result.stderr
    assert "everything is up to date" in ema("archive", "run", archive, *HERE).stdout


def test_changes_of_a_killed_command_are_read_from_a_read_only_archive(
    ema, made_fleet: Path, tmp_path: Path
):
    archive = tmp_path / "archive"
    script = """
import os, signal, sys
from pathlib import Path
from ema_archive.manifest import Manifest
from ema_archive.running import scan
from ema_archive.store import Store
Store._note = lambda self: None
with Manifest(Path(sys.argv[1]), is_new=True) as manifest, manifest.changing() as db:
    db.execute("UPDATE manifest.archive SET sources = ['/bags of a killed command']")
    db.execute("COMMIT")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run([sys.executable, "-c", script, archive], check=False)
    assert done.returncode == -signal.SIGKILL
    assert (archive / f"{FILE}.wal").exists()
    with made_read_only(archive):
        result = ema("archive", "status", archive)
        assert (result.exit_code, "of /bags of a killed" in result.stdout) == (0, True), result
    assert "of /bags of a killed command" in ema("archive", "status", archive).stdout
