"""Histories of version 0.1, files of JSON lines, are imported once and left as they are."""

import shutil
import sqlite3
from pathlib import Path

import pytest

from ema_monitor.prognosis.history import History, history_path

from .kept_histories import UNIT, entry
from .made_tests import PHASE, made_test

FOLDER = Path(__file__).parent / "histories_0_1"
LINES = FOLDER / "flap+SIM-0001.jsonl"


def opened(folder: Path) -> History:
    history = History(*UNIT, history_path(folder, *UNIT))
    history.close()
    return history


def test_file_of_the_second_format_is_imported_exactly_and_once(tmp_path: Path):
    old = tmp_path / LINES.name
    shutil.copyfile(LINES, old)
    first = opened(tmp_path)
    assert first.imported == f"5 test cycles are imported from {old.name}, which stays as it is"
    assert first.problem == ""
    assert old.read_bytes() == LINES.read_bytes()
    again = opened(tmp_path)
    assert (again.imported, again.problem) == ("", "")
    for history in (first, again):
        one, two, three = history.entries
        expected = made_test(0, seed=1, friction=0.1, backlash=0.2)
        assert one.estimate.faults == expected.faults
        assert one.estimate.unobservable[PHASE]
        assert (one.hours, one.cycles, one.count) == (12.345678901234567, 7, None)
        assert two.count is not None
        assert three.count is not None
        assert (three.count.hours, three.count.cycles) == (40.2, 9)
        assert history.unused_cycles == 1
        assert history.holds(one.stamp_ns - 10**10)


def test_file_on_read_only_media_is_imported_into_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    shutil.copyfile(LINES, tmp_path / LINES.name)

    def refuse(*_: object, **__: object) -> None:
        raise sqlite3.OperationalError("unable to open database file")

    monkeypatch.setattr(sqlite3, "connect", refuse)
    history = History(*UNIT, history_path(tmp_path, *UNIT))
    assert len(history.entries) == 3
    assert "5 test cycles are imported" in history.imported
    assert "cannot be written: unable to open database file" in history.problem
    assert history.problem.endswith("tests from now on are in memory only")


def test_file_of_the_first_format_is_imported(tmp_path: Path):
    """It has neither counts nor cycles without estimate."""
    shutil.copyfile(FOLDER / "format_1.jsonl", tmp_path / LINES.name)
    history = opened(tmp_path)
    [one] = history.entries
    assert (one.hours, one.count) == (12.345678901234567, None)


@pytest.mark.parametrize(
    ("number", "tests"), [(1, 0), (2, 0), (4, 2)], ids=["header", "first", "third"]
)
def test_tests_before_the_damage_are_imported(tmp_path: Path, number: int, tests: int):
    lines = LINES.read_bytes().splitlines(keepends=True)
    lines[number - 1] = lines[number - 1].replace(b"1", b"2", 1)
    (tmp_path / LINES.name).write_bytes(b"".join(lines))
    history = opened(tmp_path)
    assert f"{tests} test cycles are imported" in history.imported
    assert f"line {number} is damaged" in history.imported
    assert len(history.entries) == max(tests - 1, 0)
    assert (tmp_path / LINES.name).read_bytes() == b"".join(lines)


def test_line_that_a_kill_cut_off_is_left_out_and_named(tmp_path: Path):
    (tmp_path / LINES.name).write_bytes(LINES.read_bytes() + b'{"hours": 60.')
    said = opened(tmp_path).imported
    assert said == f"5 test cycles are imported from {LINES.name}, without line 7, which is cut off"


def test_file_of_another_unit_is_not_imported(tmp_path: Path):
    unit = ("flap", "SIM-0002")
    path = history_path(tmp_path, *unit)
    shutil.copyfile(LINES, path.with_suffix(".jsonl"))
    history = History(*unit, path)
    assert "0 test cycles are imported" in history.imported
    assert "it is of unit ('flap', 'SIM-0001')" in history.imported
    history.append(entry(0))
    history.close()
    assert len(opened_as(unit, tmp_path).entries) == 1


def opened_as(unit: tuple[str, str], folder: Path) -> History:
    history = History(*unit, history_path(folder, *unit))
    history.close()
    return history
