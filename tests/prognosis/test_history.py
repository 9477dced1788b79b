# SPDX-License-Identifier: Apache-2.0
"""The history of a unit survives kills and damage at any moment, without loss or overwriting."""

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from ema_core.levels import OK
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import Assessment, Count, Entry, UnusedCycle
from ema_monitor.reasons import StatedReason

from .made_tests import UNIT, entry, hours, kept, made_test

NOBODY = 65534
WRITER = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from made_tests import made_test
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Entry
history = History("flap", "SIM-0001", Path(sys.argv[1]))
n = len(history.entries)
while True:
    history.append(Entry(made_test(n), 10.0 * n, n + 1))
    n += 1
    print(n, history.problem, flush=True)
"""


def test_ten_years_of_daily_tests_take_at_most_20_megabytes():
    """The history has 3,650 tests with their assessments."""
    history = History(*UNIT)

    def add(numbers: range) -> None:
        for number in numbers:
            test = made_test(number, seed=1, friction=0.1)
            history.append(Entry(test, 10.0 * number, number + 1))
            history.assess(Assessment(test.end_ns, 10.0 * number, OK, 0.5, "friction", None))

    add(range(100))
    tracemalloc.start()
    add(range(100, 300))
    grown = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert grown / 200 * 3650 < 20e6


def test_every_number_is_restored_exactly(path: Path):
    estimate = made_test(0, seed=1, friction=0.1, backlash=0.2)
    history = History(*UNIT, path)
    history.append(Entry(estimate, 12.345678901234567, 7))
    history.append(Entry(made_test(1), np.nan, 8))
    history.close()
    again = History(*UNIT, path)
    again.close()
    first, second = again.entries
    assert (first.hours, first.cycles) == (12.345678901234567, 7)
    assert np.isnan(second.hours)
    for item in fields(Estimate):
        np.testing.assert_array_equal(
            getattr(first.estimate, item.name), getattr(estimate, item.name), err_msg=item.name
        )
        assert type(getattr(first.estimate, item.name)) is type(getattr(estimate, item.name))


def test_count_and_cycles_without_estimate_are_restored(path: Path):
    count = Count(123, 45.5, 67)
    history = History(*UNIT, path)
    history.append(UnusedCycle(1, Verdict.REFUSED, (StatedReason("gap"),)))
    history.append(Entry(test := made_test(0), 45.5, 67, count))
    history.append(UnusedCycle(test.end_ns + 2, Verdict.REFUSED, (StatedReason("gap"),)))
    history.append(UnusedCycle(test.end_ns + 3, Verdict.FAILED, (StatedReason("a phase is open"),)))
    history.close()
    again = History(*UNIT, path)
    again.close()
    assert (len(again.entries), again.entries[0].count, len(again.unused)) == (1, count, 2)
    assert again.newest == again.unused[-1]
    assert [again.holds(stamp) for stamp in (1, 2, test.end_ns)] == [True, False, True]
    assert [again.holds_valid(stamp) for stamp in (1, test.end_ns)] == [False, True]


def test_no_file_is_created_before_the_first_test(path: Path):
    assert hours(path) == ([], "")
    assert not path.parent.exists()


def test_write_ahead_log_truncated_at_any_byte_loses_at_most_the_latest_test(path: Path):
    """As after a power failure: the log is incomplete, and the file is as before."""
    running = History(*UNIT, path)
    for number in range(3):
        running.append(entry(number))
    before = path.read_bytes()
    running.append(entry(3))
    whole = path.with_name(path.name + "-wal").read_bytes()
    copy = path.with_name("copy.sqlite")
    lengths = []
    for cut in [*range(0, len(whole), 997), len(whole)]:
        copy.write_bytes(before)
        copy.with_name(copy.name + "-wal").write_bytes(whole[:cut])
        restored, problem = hours(copy)
        assert problem == ""
        assert restored == [10.0 * number for number in range(len(restored))]
        lengths.append(len(restored))
    running.close()
    assert lengths == sorted(lengths)
    assert (lengths[0], lengths[-1]) == (3, 4)


@pytest.mark.long
def test_history_survives_repeated_kills(path: Path):
    """A process that appends continuously is killed; the next one reads all reported tests."""
    reported = 0
    for kill in range(5):
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, path, Path(__file__).parent],
            stdout=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stdout is not None
            printed = [process.stdout.readline() for _ in range(3 + kill)]
            process.send_signal(signal.SIGKILL)
            printed += process.stdout.readlines()
        # Each line is a number of tests; there is no other output.
        numbers = [int(line) for line in printed]
        assert numbers == list(range(reported + 1, reported + 1 + len(numbers)))
        stored, problem = hours(path)
        assert problem == ""
        assert numbers[-1] <= len(stored) <= numbers[-1] + 1
        assert stored == [10.0 * number for number in range(len(stored))]
        reported = len(stored)


def test_history_in_use_by_another_process_is_left_alone_until_that_process_is_killed(path: Path):
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), str(Path(__file__).parent)],
        stdout=subprocess.PIPE,
        text=True,
    ) as owner:
        assert owner.stdout is not None
        assert owner.stdout.readline()
        second = History(*UNIT, path)
        owner.kill()
    assert second.problem == (
        f"the history {path} is in use by another monitor; this monitor keeps its tests in "
        "memory only"
    )
    assert (len(second.entries), second.path) == (0, None)
    third = History(*UNIT, path)
    assert (third.problem, len(third.entries) > 0) == ("", True)
    third.close()


def test_second_of_two_monitors_that_begin_a_history_names_the_reason(path: Path):
    first, second = History(*UNIT, path), History(*UNIT, path)
    first.append(entry(0))
    second.append(entry(1))
    assert "cannot be written: it is in use by another monitor" in second.problem
    first.close()
    assert hours(path) == ([0.0], "")


def test_full_disk_is_reported_and_later_tests_are_written_when_there_is_room(path: Path):
    history = History(*UNIT, path)
    history.append(entry(0))
    assert history._db is not None
    pages = history._db.execute("PRAGMA page_count").fetchone()[0]
    history._db.execute(f"PRAGMA max_page_count = {pages}")
    for number in (1, 2, 3):
        history.append(entry(number))
    assert "cannot be written: database or disk is full" in history.problem
    assert "in memory only" in history.problem
    assert len(history.entries) == 4
    history._db.execute("PRAGMA max_page_count = 100000")
    history.append(entry(4))
    assert history.problem == ""
    history.close()
    assert hours(path) == ([0.0, 10.0, 20.0, 30.0, 40.0], "")


@contextmanager
def read_only(folder: Path) -> Iterator[None]:
    """Make a folder read-only, even for root."""
    is_root = os.geteuid() == 0
    paths = [folder, *folder.iterdir()]
    modes = [item.stat().st_mode for item in paths]
    for item in paths:
        item.chmod(0o555)
    if is_root:
        # pytest creates folders that are accessible only to their owner.
        for parent in list(folder.parents)[:4]:
            if parent != Path("/tmp") and parent.stat().st_mode & 0o7777 == 0o700:
                parent.chmod(0o711)
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        if is_root:
            os.seteuid(0)
        for item, mode in zip(paths, modes, strict=True):
            item.chmod(mode)


@pytest.mark.parametrize("is_killed", [False, True])
def test_history_on_read_only_media_is_read_and_continued_in_memory(path: Path, is_killed: bool):
    writer = History(*UNIT, path)
    for number in range(3):
        writer.append(entry(number))
    media = path.parent
    if is_killed:
        # The write-ahead log has not been transferred into the file.
        media = path.parent.with_name("media")
        shutil.copytree(path.parent, media)
    writer.close()
    with read_only(media):
        history = History(*UNIT, media / path.name)
        history.append(entry(3))
    assert [item.hours for item in history.entries] == [0.0, 10.0, 20.0, 30.0]
    assert "cannot be written" in history.problem
    assert "in memory only" in history.problem
    assert history.path is None
    history.close()
    assert hours(media / path.name) == ([0.0, 10.0, 20.0], "")


def test_history_stays_in_memory_if_its_folder_cannot_be_created(tmp_path: Path):
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    history = History(*UNIT, blocked / "flap.sqlite")
    history.append(entry(0))
    assert len(history.entries) == 1
    assert "cannot be" in history.problem


def test_units_have_separate_files_in_the_folder(tmp_path: Path):
    units = [("a", "b+c"), ("a+b", "c"), ("..", ".."), ("a/b", "c"), ("", ""), ("Flügel", "1 2")]
    paths = [history_path(tmp_path, *unit) for unit in units]
    assert len(set(paths)) == len(units)
    assert all(path.parent == tmp_path for path in paths)


def test_closed_history_writes_no_more(path: Path):
    before = kept(path, 1)
    history = History(*UNIT, path)
    history.close()
    history.append(entry(1))
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "damaged_record",
    [
        # One digit of a number is changed, so that it is still JSON.
        "replace(record, '0.01', '0.02')",
        "CAST(record || x'ff' AS TEXT)",
    ],
)
def test_damaged_record_is_detected_and_the_other_tests_are_kept(path: Path, damaged_record: str):
    kept(path)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(f"UPDATE test SET record = {damaged_record} WHERE number = 2")
    damaged = path.read_bytes()
    history = History(*UNIT, path)
    aside = path.with_name("flap.set_aside_1.sqlite")
    assert [item.hours for item in history.entries] == [0.0, 20.0]
    for words in (str(path), aside.name, "test 2 is damaged", "the 2 intact test cycles"):
        assert words in history.problem
    assert aside.read_bytes() == damaged
    history.append(entry(4))
    history.close()
    assert hours(path) == ([0.0, 20.0, 40.0], "")


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_truncated_file_is_renamed_unchanged(path: Path, share: float):
    whole = kept(path, 20)
    damaged = whole[: int(share * len(whole))]
    path.write_bytes(damaged)
    stored, problem = hours(path)
    assert stored == [10.0 * number for number in range(len(stored))]
    assert "renamed to flap.set_aside_1.sqlite" in problem
    assert path.with_name("flap.set_aside_1.sqlite").read_bytes() == damaged
    # Readable tests are in the new file.
    assert hours(path) == (stored, "") if stored else not path.exists()


@pytest.mark.parametrize("content", [b"\x00\x01\xff" * 300, b"hours,friction\n", b"\x00" * 5000])
def test_file_that_is_not_a_history_is_renamed(path: Path, content: bytes):
    path.parent.mkdir()
    path.write_bytes(content)
    stored, problem = hours(path)
    assert stored == []
    assert "not a database" in problem
    assert path.with_name("flap.set_aside_1.sqlite").read_bytes() == content


def test_other_database_and_other_schema_are_renamed_unchanged(path: Path):
    path.parent.mkdir()
    for number, statement in enumerate(("CREATE TABLE flights (x)", "PRAGMA user_version = 6"), 1):
        with closing(sqlite3.connect(path)) as db, db:
            db.execute("CREATE TABLE IF NOT EXISTS x (y)")
            db.execute(statement)
        content = path.read_bytes()
        assert "its schema version is" in hours(path)[1]
        assert path.with_name(f"flap.set_aside_{number}.sqlite").read_bytes() == content


@pytest.mark.parametrize("how", ["deleted", "moved", "folder deleted"])
def test_file_deleted_during_use_is_written_again_completely(path: Path, how: str):
    history = History(*UNIT, path)
    history.append(entry(0))
    history.append(UnusedCycle(1, Verdict.REFUSED, (StatedReason("gap"),)))
    history.append(entry(1))
    history.assess(Assessment(entry(1).stamp_ns, 10.0, OK, 0.9, "", None))
    moved = path.with_name("elsewhere")
    if how == "moved":
        path.rename(moved)
    elif how == "deleted":
        path.unlink()
    else:
        shutil.rmtree(path.parent)
    history.append(UnusedCycle(2, Verdict.REFUSED, (StatedReason("gap"),)))
    history.append(entry(2))
    history.assess(Assessment(entry(2).stamp_ns, 20.0, OK, 0.9, "", None))
    assert "was deleted or moved while it was in use" in history.problem
    history.close()
    again = History(*UNIT, path)
    again.close()
    assert [item.hours for item in again.entries] == [0.0, 10.0, 20.0]
    assert (again.holds(1), again.holds(2), again.problem) == (True, True, "")
    assert again.assessments == history.assessments
    if how == "moved":
        assert hours(moved) == ([0.0, 10.0], "")


def test_tests_that_another_monitor_wrote_are_not_overwritten(path: Path):
    late = History(*UNIT, path)
    written = kept(path)
    late.append(entry(7))
    late.close()
    assert path.read_bytes() == written
    assert "written by another monitor" in late.problem
    assert [item.hours for item in late.entries] == [70.0]


def test_history_of_another_unit_is_renamed_and_no_file_is_overwritten(path: Path):
    first = kept(path)
    second_unit = ("flap", "SIM-0002")
    stored, problem = hours(path, second_unit)
    assert stored == []
    assert "it belongs to unit [('flap', 'SIM-0001')], not ('flap', 'SIM-0002')" in problem
    second = kept(path, 1)
    hours(path, second_unit)
    assert path.with_name("flap.set_aside_1.sqlite").read_bytes() == first
    assert path.with_name("flap.set_aside_2.sqlite").read_bytes() == second


DELETED = "DELETE FROM test WHERE number = {0}"
MOVED = "UPDATE test SET number = {1} WHERE number = {0}"
COPIED = "INSERT INTO test SELECT {1}, record, crc32 FROM test WHERE number = {0}"


@pytest.mark.parametrize(
    ("statements", "place", "intact"),
    [
        ([DELETED.format(2)], "test 2 is missing", [1, 3, 4, 5]),
        ([DELETED.format(2), DELETED.format(3)], "tests 2 to 3 are missing", [1, 4, 5]),
        ([DELETED.format(5)], "test 5 is missing", [1, 2, 3, 4]),
        ([DELETED.format(1)], "test 1 is missing", [2, 3, 4, 5]),
        # The later numbers close the gap.
        (
            [DELETED.format(2), *(MOVED.format(n, n - 1) for n in (3, 4, 5))],
            "test 2 is damaged: its checksum is wrong, and 3 further defects",
            [1],
        ),
        ([COPIED.format(5, 6)], "test 6 is damaged", [1, 2, 3, 4, 5]),
        (
            [*(MOVED.format(n, n + 1) for n in (5, 4, 3)), COPIED.format(2, 3)],
            "test 3 is damaged",
            [1, 2],
        ),
        (
            [MOVED.format(2, 9), MOVED.format(3, 2), MOVED.format(9, 3)],
            "test 2 is damaged",
            [1, 4, 5],
        ),
    ],
)  # fmt: skip
def test_deleted_repeated_or_swapped_entry_is_named_and_the_intact_ones_are_kept(
    path: Path, statements: list[str], place: str, intact: list[int]
):
    kept(path, 5)
    with closing(sqlite3.connect(path)) as db, db:
        for statement in statements:
            db.execute(statement)
    changed = path.read_bytes()
    stored, problem = hours(path)
    assert stored == [10.0 * (number - 1) for number in intact]
    assert place in problem
    assert path.with_name("flap.set_aside_1.sqlite").read_bytes() == changed
    assert hours(path) == (stored, "")


def test_late_tests_are_in_the_order_of_their_stamps(path: Path):
    history = History(*UNIT, path)
    for number in (0, 5, 2, 6):
        history.append(entry(number))
    history.close()
    assert hours(path) == ([0.0, 20.0, 50.0, 60.0], "")


@pytest.mark.parametrize("table", ["assessment", "growth", "unit"])
def test_history_that_lacks_a_table_is_renamed_and_its_tests_are_kept(path: Path, table: str):
    kept(path)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(f"DROP TABLE {table}")
    stored, problem = hours(path)
    assert f"no such table: {table}" in problem
    assert "renamed to" in problem
    # Without the table of the unit, it is unknown to which unit the tests belong.
    assert stored == ([] if table == "unit" else [0.0, 10.0, 20.0])
    assert hours(path) == (stored, "")
