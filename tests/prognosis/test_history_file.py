"""Damaged files of histories, those of others, in use or gone: nothing is lost or overwritten."""

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from ema_core.levels import OK
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Assessment, UnusedCycle

from .kept_histories import UNIT, entry, hours, kept


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "histories" / "flap.sqlite"


@pytest.mark.parametrize(
    "damaged_record",
    [
        # One digit of one figure: it is JSON still.
        "replace(record, '0.01', '0.02')",
        "CAST(record || x'ff' AS TEXT)",
    ],
)
def test_damaged_record_is_found_and_the_other_tests_are_kept(path: Path, damaged_record: str):
    kept(path)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(f"UPDATE test SET record = {damaged_record} WHERE number = 2")
    damaged = path.read_bytes()
    history = History(*UNIT, path)
    aside = path.with_name("flap.set_aside_1.sqlite")
    assert [item.hours for item in history.entries] == [0.0, 20.0]
    for words in (str(path), aside.name, "test 2 is damaged", "the 2 test cycles that are intact"):
        assert words in history.problem
    assert aside.read_bytes() == damaged
    history.append(entry(4))
    history.close()
    assert hours(path) == ([0.0, 20.0, 40.0], "")


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_truncated_file_is_set_aside_whole(path: Path, share: float):
    whole = kept(path, 20)
    damaged = whole[: int(share * len(whole))]
    path.write_bytes(damaged)
    found, problem = hours(path)
    assert found == [10.0 * number for number in range(len(found))]
    assert "set aside as flap.set_aside_1.sqlite" in problem
    assert path.with_name("flap.set_aside_1.sqlite").read_bytes() == damaged
    # What could be read of it is in the new file.
    assert hours(path) == (found, "") if found else not path.exists()


@pytest.mark.parametrize("content", [b"\x00\x01\xff" * 300, b"hours,friction\n", b"\x00" * 5000])
def test_file_that_is_no_history_is_set_aside(path: Path, content: bytes):
    path.parent.mkdir()
    path.write_bytes(content)
    found, problem = hours(path)
    assert found == []
    assert "not a database" in problem
    assert path.with_name("flap.set_aside_1.sqlite").read_bytes() == content


def test_other_database_and_other_schema_are_set_aside_as_they_are(path: Path):
    path.parent.mkdir()
    for number, statement in enumerate(("CREATE TABLE flights (x)", "PRAGMA user_version = 6"), 1):
        with closing(sqlite3.connect(path)) as db, db:
            db.execute("CREATE TABLE IF NOT EXISTS x (y)")
            db.execute(statement)
        content = path.read_bytes()
        assert "its schema version is" in hours(path)[1]
        assert path.with_name(f"flap.set_aside_{number}.sqlite").read_bytes() == content


@pytest.mark.parametrize("how", ["deleted", "moved", "folder deleted"])
def test_file_that_is_gone_while_in_use_is_written_anew_whole(path: Path, how: str):
    history = History(*UNIT, path)
    history.append(entry(0))
    history.append(UnusedCycle(1, "refused", "gap"))
    history.append(entry(1))
    history.assess(Assessment(entry(1).stamp_ns, 10.0, OK, 0.9, "", None))
    moved = path.with_name("elsewhere")
    if how == "moved":
        path.rename(moved)
    elif how == "deleted":
        path.unlink()
    else:
        shutil.rmtree(path.parent)
    history.append(UnusedCycle(2, "refused", "gap"))
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


def test_file_of_others_at_the_place_of_one_that_is_gone_is_left_alone(path: Path):
    history = History(*UNIT, path)
    history.append(entry(0))
    path.rename(path.with_name("elsewhere"))
    other = kept(path, 2)
    history.append(entry(7))
    history.close()
    assert path.read_bytes() == other
    assert "written by another monitor" in history.problem


def test_what_another_monitor_wrote_since_is_not_overwritten(path: Path):
    late = History(*UNIT, path)
    written = kept(path)
    late.append(entry(7))
    late.close()
    assert path.read_bytes() == written
    assert "written by another monitor" in late.problem
    assert [item.hours for item in late.entries] == [70.0]


def test_history_of_another_unit_is_set_aside_and_none_is_overwritten(path: Path):
    first = kept(path)
    other = ("flap", "SIM-0002")
    found, problem = hours(path, other)
    assert found == []
    assert "it is of unit [('flap', 'SIM-0001')], not ('flap', 'SIM-0002')" in problem
    second = kept(path, 1)
    hours(path, other)
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
        # The numbers closed up behind it.
        (
            [DELETED.format(2), *(MOVED.format(n, n - 1) for n in (3, 4, 5))],
            "test 2 is damaged: its checksum is wrong, and 3 more of the kind",
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
def test_entry_that_is_deleted_doubled_or_swapped_is_named_and_the_intact_are_kept(
    path: Path, statements: list[str], place: str, intact: list[int]
):
    kept(path, 5)
    with closing(sqlite3.connect(path)) as db, db:
        for statement in statements:
            db.execute(statement)
    changed = path.read_bytes()
    found, problem = hours(path)
    assert found == [10.0 * (number - 1) for number in intact]
    assert place in problem
    assert path.with_name("flap.set_aside_1.sqlite").read_bytes() == changed
    assert hours(path) == (found, "")


def test_tests_that_came_late_are_in_the_order_of_their_stamps(path: Path):
    history = History(*UNIT, path)
    for number in (0, 5, 2, 6):
        history.append(entry(number))
    history.close()
    assert hours(path) == ([0.0, 20.0, 50.0, 60.0], "")


@pytest.mark.parametrize("table", ["assessment", "growth", "unit"])
def test_history_that_lacks_a_table_is_set_aside_with_its_tests_kept(path: Path, table: str):
    kept(path)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(f"DROP TABLE {table}")
    found, problem = hours(path)
    assert f"no such table: {table}" in problem
    assert "set aside" in problem
    # Of whom it is nobody knows without the table of the unit.
    assert found == ([] if table == "unit" else [0.0, 10.0, 20.0])
    assert hours(path) == (found, "")
