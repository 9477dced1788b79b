"""Damaged files of histories, those of others, in use or gone: nothing is lost or overwritten."""

import json
import shutil
import sqlite3
import zlib
from contextlib import closing
from pathlib import Path

import pytest

from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import UnusedCycle

from .kept_histories import UNIT, entry, hours, kept


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "histories" / "flap.sqlite"


def test_damaged_figure_is_found_and_the_other_tests_are_kept(path: Path):
    kept(path)
    with closing(sqlite3.connect(path)) as db, db:
        # One digit of one figure: it is JSON still.
        db.execute("UPDATE test SET record = replace(record, '0.01', '0.02') WHERE number = 2")
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
    moved = path.with_name("elsewhere")
    if how == "moved":
        path.rename(moved)
    elif how == "deleted":
        path.unlink()
    else:
        shutil.rmtree(path.parent)
    history.append(UnusedCycle(2, "refused", "gap"))
    history.append(entry(2))
    assert "was deleted or moved while it was in use" in history.problem
    history.close()
    again = History(*UNIT, path)
    again.close()
    assert [item.hours for item in again.entries] == [0.0, 10.0, 20.0]
    assert (again.holds(1), again.holds(2), again.problem) == (True, True, "")
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


def test_history_in_use_is_left_alone(path: Path):
    owner = History(*UNIT, path)
    owner.append(entry(0))
    second = History(*UNIT, path)
    assert "in use by another monitor" in second.problem
    second.append(entry(1))
    assert len(second.entries) == 1
    owner.append(entry(2))
    owner.close()
    assert hours(path) == ([0.0, 20.0], "")


DELETED = "DELETE FROM test WHERE number = {0}"
MOVED = "UPDATE test SET number = {1} WHERE number = {0}"
COPIED = "INSERT INTO test SELECT {1}, record, crc32, chain FROM test WHERE number = {0}"


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
            "test 2 does not follow",
            [1, 3, 4, 5],
        ),
        ([COPIED.format(5, 6)], "test 6 does not follow", [1, 2, 3, 4, 5]),
        (
            [*(MOVED.format(n, n + 1) for n in (5, 4, 3)), COPIED.format(2, 3)],
            "test 3 does not follow",
            [1, 2, 3, 4, 5],
        ),
        (
            [MOVED.format(2, 9), MOVED.format(3, 2), MOVED.format(9, 3)],
            "test 2 does not follow",
            [1, 3, 4, 5],
        ),
        (["DELETE FROM head"], "test 5 is not the one that was written last", [1, 2, 3, 4, 5]),
    ],
)  # fmt: skip
def test_entry_that_is_deleted_doubled_or_swapped_is_named_and_the_intact_are_kept(
    path: Path, statements: list[str], place: str, intact: list[int]
):
    """Each row's own checksum is right."""
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


def test_clock_that_goes_back_does_not_break_the_chain(path: Path):
    history = History(*UNIT, path)
    for number in (0, 5, 2, 6):
        history.append(entry(number))
    history.close()
    # In the order of their stamps.
    assert hours(path) == ([0.0, 20.0, 50.0, 60.0], "")


@pytest.mark.parametrize("table", ["assessment", "head", "growth", "unit"])
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


@pytest.mark.parametrize("chain", [2**62, "x", 1.5])
def test_hash_that_is_none_is_a_broken_chain(path: Path, chain: object):
    """Of a whole number, as many bytes were asked for."""
    kept(path)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("UPDATE test SET chain = ? WHERE number = 2", (chain,))
    found, problem = hours(path)
    assert "does not follow from the one before it" in problem
    assert found == [0.0, 10.0, 20.0]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("end_ns", "5"),
        ("end_ns", 2**63),
        ("end_ns", 1.7e18),
        ("cycles", 2**70),
        ("cycles", 2**63 - 1),
        ("cycles", -1),
        ("cycles", None),
        ("hours", 10**400),
        ("count", [1]),
        ("count", {"stamp_ns": 2**63, "hours": 1.0, "cycles": 1}),
    ],
)
def test_record_with_an_impossible_value_is_damaged_and_the_other_tests_are_kept(
    path: Path, name: str, value: object
):
    kept(path, 4)
    with closing(sqlite3.connect(path)) as db, db:
        (text,) = db.execute("SELECT record FROM test WHERE number = 3").fetchone()
        record = json.loads(text)
        (record if name != "end_ns" else record["estimate"])[name] = value
        text = json.dumps(record)
        row = (text, zlib.crc32(text.encode()))
        db.execute("UPDATE test SET record = ?, crc32 = ? WHERE number = 3", row)
    found, problem = hours(path)
    assert found == [0.0, 10.0, 30.0]
    assert "set aside" in problem
    assert "test 3 does not follow from the one before it" in problem
    assert hours(path) == (found, "")


def test_record_that_is_no_text_is_damaged_and_the_other_tests_are_kept(path: Path):
    kept(path)
    with closing(sqlite3.connect(path)) as db, db:
        statement = "UPDATE test SET record = CAST(record || x'ff' AS TEXT) WHERE number = 2"
        db.execute(statement)
    found, problem = hours(path)
    assert "test 2 is damaged: its checksum is wrong" in problem
    assert found == [0.0, 20.0]
    assert hours(path) == (found, "")
