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
from ema_monitor.prognosis.counts import Count
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import Entry, UnusedCycle, as_line, from_line

from .kept_histories import UNIT, entry, hours, kept
from .made_tests import made_test


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "histories" / "flap.jsonl"


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


def test_windows_without_estimate_are_held_as_well(path: Path):
    history = History(*UNIT, path)
    history.append(UnusedCycle(1))
    history.append(entry(0))
    history.close()
    again = History(*UNIT, path)
    again.close()
    stamp_ns = entry(0).stamp_ns
    assert [again.holds(stamp) for stamp in (1, 2, stamp_ns)] == [True, False, True]
    assert [again.holds_valid(stamp) for stamp in (1, stamp_ns)] == [False, True]


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
