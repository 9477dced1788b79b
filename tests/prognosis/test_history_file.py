"""Damaged files of histories, those of others, in use or gone: nothing is lost or overwritten."""

from pathlib import Path

import pytest

from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import UnusedCycle

from .kept_histories import UNIT, entry, hours, kept


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "histories" / "flap.jsonl"


@pytest.mark.parametrize("place", ["header", "first", "last"])
def test_corrupted_history_is_set_aside_whole_and_a_new_one_begun(path: Path, place: str):
    lines = kept(path).splitlines(keepends=True)
    number = {"header": 0, "first": 1, "last": 3}[place]
    # One digit of one figure: it is JSON still.
    at = lines[number].index(b"1")
    lines[number] = lines[number][:at] + b"2" + lines[number][at + 1 :]
    spoiled = b"".join(lines)
    path.write_bytes(spoiled)
    history = History(*UNIT, path)
    aside = path.with_name("flap.set_aside_1.jsonl")
    assert history.entries == []
    assert str(path) in history.problem
    assert aside.name in history.problem
    assert "checksum" in history.problem
    assert aside.read_bytes() == spoiled
    history.append(entry(4))
    history.close()
    assert hours(path) == ([40.0], "")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"\x00\x01\xff" * 300 + b"\n", "header"),
        (b"hours,friction\n10,0.1\n", "header"),
        (b"\n", "header"),
        (b"\x00" * 5000, "no line of a history"),
    ],
)
def test_file_that_is_no_history_is_set_aside(path: Path, content: bytes, reason: str):
    path.parent.mkdir()
    path.write_bytes(content)
    found, problem = hours(path)
    assert found == []
    assert reason in problem
    assert path.with_name("flap.set_aside_1.jsonl").read_bytes() == content


def test_damaged_end_is_left_out_and_the_file_kept_as_it_was(path: Path):
    """As a loss of power leaves it: a stretch of zeros."""
    spoiled = kept(path) + b"\x00" * 3000
    path.write_bytes(spoiled)
    found, problem = hours(path)
    assert found == [0.0, 10.0, 20.0]
    assert "damaged end" in problem
    assert path.with_name("flap.set_aside_1.jsonl").read_bytes() == spoiled


def test_damaged_end_is_cut_off_and_copied_once(path: Path):
    whole = kept(path)
    path.write_bytes(whole + b"\x00" * 3000)
    for _ in range(3):
        hours(path)
    assert path.read_bytes() == whole
    assert [file.name for file in sorted(path.parent.iterdir())] == [
        "flap.jsonl",
        "flap.set_aside_1.jsonl",
    ]


@pytest.mark.parametrize("how", ["deleted", "moved", "folder deleted"])
def test_file_that_is_gone_while_in_use_is_written_anew_whole(path: Path, how: str):
    history = History(*UNIT, path)
    history.append(entry(0))
    history.append(UnusedCycle(1))
    history.append(entry(1))
    moved = path.with_name("elsewhere")
    if how == "moved":
        path.rename(moved)
    else:
        path.unlink()
        if how == "folder deleted":
            path.parent.rmdir()
    history.append(UnusedCycle(2))
    history.append(entry(2))
    assert "was deleted or moved while it was in use" in history.problem
    written = path.read_bytes()
    history.close()
    assert hours(path) == ([0.0, 10.0, 20.0], "")
    # As if it had never been gone.
    other = History(*UNIT, path.with_name("other.jsonl"))
    for test in (entry(0), UnusedCycle(1), entry(1), UnusedCycle(2), entry(2)):
        other.append(test)
    other.close()
    assert written == path.with_name("other.jsonl").read_bytes()
    if how == "moved":
        assert len(moved.read_bytes().splitlines()) == 4


def test_file_of_others_at_the_place_of_one_that_is_gone_is_left_alone(path: Path):
    history = History(*UNIT, path)
    history.append(entry(0))
    path.unlink()
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
    assert "'SIM-0001', not 'SIM-0002'" in problem
    second = kept(path, 1)
    hours(path, other)
    assert path.with_name("flap.set_aside_1.jsonl").read_bytes() == first
    assert path.with_name("flap.set_aside_2.jsonl").read_bytes() == second


def test_history_in_use_is_left_alone(path: Path):
    owner = History(*UNIT, path)
    owner.append(entry(0))
    before = path.read_bytes()
    second = History(*UNIT, path)
    assert "in use by another monitor" in second.problem
    second.append(entry(1))
    assert path.read_bytes() == before
    assert len(second.entries) == 1
    owner.close()
    assert hours(path) == ([0.0], "")
