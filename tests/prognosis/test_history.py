"""The history of a unit survives being killed, and tells of what it cannot use."""

import os
import signal
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from ema_monitor.estimate import Estimate
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import Entry, UnusedCycle, as_line, from_line
from ema_monitor.prognosis.usage import Count

from .made_tests import made_test

UNIT = ("flap", "SIM-0001")


def entry(number: int) -> Entry:
    return Entry(made_test(number, friction=0.01 * number), 10.0 * number, number + 1, 1.0)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "histories" / "flap.jsonl"


def kept(path: Path, n: int = 3) -> bytes:
    """A history of n tests in a file; returns what the file holds."""
    history = History(*UNIT, path)
    for number in range(n):
        history.append(entry(number))
    history.close()
    return path.read_bytes()


def hours(path: Path, unit: tuple[str, str] = UNIT) -> tuple[list[float], str]:
    history = History(*unit, path)
    history.close()
    return [item.hours for item in history.entries], history.problem


def test_every_figure_comes_back_to_the_last_bit(path: Path):
    estimate = made_test(0, seed=1, friction=0.1, backlash=0.2)
    history = History(*UNIT, path)
    history.append(Entry(estimate, 12.345678901234567, 7, 1.25))
    history.append(Entry(made_test(1), np.nan, 8, 1.0))
    history.close()
    again = History(*UNIT, path)
    again.close()
    first, second = again.entries
    assert (first.hours, first.cycles, first.duty) == (12.345678901234567, 7, 1.25)
    assert np.isnan(second.hours)
    for item in fields(Estimate):
        np.testing.assert_array_equal(
            getattr(first.estimate, item.name), getattr(estimate, item.name), err_msg=item.name
        )
        assert type(getattr(first.estimate, item.name)) is type(getattr(estimate, item.name))


def test_count_and_cycles_without_estimate_come_back(path: Path):
    count = Count(123, 45.5, 67)
    history = History(*UNIT, path)
    history.append(UnusedCycle(1))
    history.append(Entry(made_test(0), 45.5, 67, 1.0, count))
    history.append(UnusedCycle(2))
    history.append(UnusedCycle(3))
    history.close()
    again = History(*UNIT, path)
    again.close()
    assert (len(again.entries), again.entries[0].count, again.unused_cycles) == (1, count, 2)


def test_file_of_the_first_format_is_read_and_gone_on_with(path: Path):
    """It has neither counts nor cycles without estimate."""
    lines = [from_line(line) for line in kept(path, 2).splitlines()]
    lines[0]["format"] = "ema_history 1"
    for line in lines[1:]:
        del line["count"]
    path.write_bytes(b"".join(as_line(line) for line in lines))
    history = History(*UNIT, path)
    assert [item.count for item in history.entries] == [None, None]
    history.append(UnusedCycle(1))
    history.append(entry(5))
    history.close()
    assert hours(path) == ([0.0, 10.0, 50.0], "")


def test_format_that_is_not_known_is_set_aside(path: Path):
    path.parent.mkdir()
    path.write_bytes(as_line({"format": "ema_history 3"}))
    assert "its format is 'ema_history 3', expected 'ema_history 2'" in hours(path)[1]


def test_nothing_is_made_before_the_first_test(path: Path):
    assert hours(path) == ([], "")
    assert not path.parent.exists()


def test_file_cut_off_at_any_byte_loses_the_current_entry_at_most(path: Path):
    whole = kept(path, 2)
    ends = [i + 1 for i, byte in enumerate(whole) if byte == ord("\n")]
    # Every byte around the ends of lines, and some between.
    cuts = {c for end in [0, *ends] for c in range(end - 3, end + 4) if 0 <= c <= len(whole)}
    for cut in sorted(cuts | set(range(0, len(whole), 97))):
        path.write_bytes(whole[:cut])
        complete = max(sum(end <= cut for end in ends) - 1, 0)
        history = History(*UNIT, path)
        assert (len(history.entries), history.problem) == (complete, ""), cut
        history.append(entry(5))
        history.close()
        assert hours(path) == ([*[0.0, 10.0][:complete], 50.0], ""), cut


def test_remains_of_a_line_that_was_cut_off_are_gone_from_the_file(path: Path):
    path.write_bytes(kept(path, 1) + b'{"hours": 10.0, ' + b" " * 10_000)
    history = History(*UNIT, path)
    history.append(entry(5))
    history.close()
    assert hours(path) == ([0.0, 50.0], "")
    assert len(path.read_bytes().splitlines()) == 3
    assert b"      " not in path.read_bytes()


def test_history_survives_kill_in_the_midst_of_writing(path: Path):
    """A process that appends without end is killed; the next one finds all that it told of."""
    code = (
        "import sys; from pathlib import Path; sys.path.insert(0, sys.argv[2]);"
        "from made_tests import made_test;"
        "from ema_monitor.prognosis.history import History;"
        "from ema_monitor.prognosis.history_entry import Entry;"
        "history = History('flap', 'SIM-0001', Path(sys.argv[1]));"
        "n = 0\n"
        "while True:\n"
        "    history.append(Entry(made_test(n), 10.0 * n, n + 1, 1.0)); n += 1\n"
        "    print(n, flush=True)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, path, Path(__file__).parent], stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        told = [int(process.stdout.readline()) for _ in range(20)]
        process.send_signal(signal.SIGKILL)
        told += [int(line) for line in process.stdout.read().split()]
    found, problem = hours(path)
    assert problem == ""
    assert told[-1] <= len(found) <= told[-1] + 1


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


def test_disk_that_cannot_be_written_is_told_and_caught_up_with(
    path: Path, monkeypatch: pytest.MonkeyPatch
):
    history = History(*UNIT, path)
    history.append(entry(0))

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        history.append(entry(1))
    assert "No space left on device" in history.problem
    assert len(history.entries) == 2
    history.append(entry(2))
    assert history.problem == ""
    history.close()
    assert hours(path) == ([0.0, 10.0, 20.0], "")


def test_folder_that_cannot_be_made_leaves_the_history_in_memory(tmp_path: Path):
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    history = History(*UNIT, blocked / "flap.jsonl")
    history.append(entry(0))
    assert len(history.entries) == 1
    assert "cannot be" in history.problem


def test_units_have_files_of_their_own_within_the_folder(tmp_path: Path):
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
