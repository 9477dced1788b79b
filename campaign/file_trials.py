#!/usr/bin/env python3
"""Trials with files that fail, in a process that ``faulty_files.cpp`` is loaded into.

LD_PRELOAD=faulty_files.so python file_trials.py SEED CASE TRIALS RESULT
"""

import ctypes
import json
import os
import select
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import fuzz_seeds
import numpy as np
from made_tests import UNIT, entry_at
from rclpy.qos import QoSProfile

from ema_core.files import complete_file
from ema_interfaces.msg import FaultVectorStamped
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import load_calibration
from ema_monitor.prognosis.history import History
from ema_recording.reader import Bag
from ema_recording.writer import BagWriter

KINDS: Final = {
    "no space left": 1,
    "input/output error": 2,
    "read-only": 3,
    "short write": 4,
    "killed": 5,
    "killed in a write": 6,
    "power lost": 7,
}
"""What happens, with its number in ``faulty_files.cpp``."""

_DIES: Final = ("killed", "killed in a write", "power lost")
_HANGS_S: Final = 60.0
_TESTS: Final = 8
_MESSAGES: Final = 120
_FLUSH_EVERY: Final = 10
_TYPE: Final = "ema_interfaces/msg/FaultVectorStamped"

Tell = Callable[[Any], None]


@dataclass(frozen=True)
class Subject:
    """Something that is kept in files.

    Attributes
    ----------
    changes
        About how many calls change files in it.
    prepare
        Makes what is there before.
    work
        Writes, and tells what it was promised.
    check
        Returns what does not hold, of the folder, what was told, and what happened.
    """

    changes: int
    prepare: Callable[[Path], None]
    work: Callable[[Path, Tell], None]
    check: Callable[[Path, list[Any], str], list[str]]


def _nothing(folder: Path) -> None:
    del folder


def _write_history(folder: Path, tell: Tell) -> None:
    history = History(*UNIT, folder / "histories" / "unit.sqlite")
    for number in range(_TESTS):
        history.append(entry_at(number))
        tell([number, history.problem])
        if number == _TESTS // 2:
            history.keep_growth(b"x" * 9000)
    history.close()


def _check_history(folder: Path, told: list[Any], what: str) -> list[str]:
    path, wrong = folder / "histories" / "unit.sqlite", []
    promised = set()
    for number, problem in told:
        promised = {*range(number + 1)} if not problem else promised
    again = History(*UNIT, path)
    again.close()
    numbers = {entry_at(number).stamp_ns: number for number in range(_TESTS)}
    found = [numbers[entry.stamp_ns] for entry in again.entries]
    if missing := promised - {*found}:
        wrong.append(f"tests {sorted(missing)} are lost ({again.problem!r})")
    if found != sorted(set(found)):
        wrong.append(f"tests in the order {found}")
    if again.problem:
        wrong.append(f"after it: {again.problem}")
    if what not in _DIES and len(told) != _TESTS:
        wrong.append(f"only {len(told)} of {_TESTS} tests were taken")
    return wrong


def _calibration(number: int) -> Calibration:
    return replace(Calibration.builtin().of_any_motion(), windows=number)


def _prepare_calibration(folder: Path) -> None:
    _calibration(1).save(folder / "unit.yaml")


def _write_calibration(folder: Path, tell: Tell) -> None:
    try:
        _calibration(2).save(folder / "unit.yaml")
    except OSError as error:
        tell(["refused", str(error)])
    else:
        tell(["stored", ""])


def _check_calibration(folder: Path, told: list[Any], what: str) -> list[str]:
    del what
    loaded = load_calibration(folder / "unit.yaml")
    return _either(loaded.calibration_id, told, _calibration(1), _calibration(2))


def _either(found: str, told: list[Any], old: Any, new: Any) -> list[str]:
    """Return what is wrong with a file that is to be the old or the new one."""
    before, after = (getattr(one, "calibration_id", one) for one in (old, new))
    if not told or "it is stored" in told[0][1]:
        expected = [before, after]
    else:
        expected = [after if told[0][0] == "stored" else before]
    return [] if found in expected else [f"{found[:60]!r} is there, told was {told}"]


def _prepare_result(folder: Path) -> None:
    (folder / "result.json").write_text("old" * 3000)


def _write_result(folder: Path, tell: Tell) -> None:
    try:
        with complete_file(folder / "result.json") as partial, partial.open("w") as file:
            for _ in range(4):
                file.write("new" * 3000)
                file.flush()
    except OSError as error:
        tell(["refused", str(error)])
    else:
        tell(["stored", ""])


def _check_result(folder: Path, told: list[Any], what: str) -> list[str]:
    del what
    text = (folder / "result.json").read_text()
    return _either(text, told, "old" * 3000, "new" * 12000)


def _message(number: int) -> bytes:
    return fuzz_seeds.cdr_of(_TYPE, {"cycle": number, "actuator_id": "x" * (number % 50)})


def _write_bag(folder: Path, tell: Tell) -> None:
    try:
        with BagWriter(
            folder / "bag", chunk_bytes=700, max_bytes=3000, flush_s=10.0, waits_for_room=True
        ) as bag:
            bag.add_topic("/true_faults", FaultVectorStamped, QoSProfile(depth=1))
            for number in range(_MESSAGES):
                bag.write_serialized("/true_faults", _message(number), 1000 + number)
                if number % _FLUSH_EVERY == _FLUSH_EVERY - 1:
                    bag.flush()
                    if bag.failure is None:
                        tell(["flushed", number, sum(gap.count for gap in bag.gaps)])
            gaps = sum(gap.count for gap in bag.gaps)
        tell(["closed", _MESSAGES, gaps])
    except OSError as error:
        tell(["refused", str(error)])


def _check_bag(folder: Path, told: list[Any], what: str) -> list[str]:
    flushed = [item for item in told if item[0] in ("flushed", "closed")]
    try:
        bag = Bag(folder / "bag")
        items = list(bag.raw_messages())
    except (FileNotFoundError, ValueError) as error:
        return [f"{flushed[-1]} was told, now {error}"] if flushed and what != "power lost" else []
    wrong, found = [], [item.log_time_ns - 1000 for item in items]
    if found != sorted(set(found)):
        wrong.append(f"messages in the order {found}")
    if any(bytes(item.message) != _message(n) for n, item in zip(found, items, strict=True)):
        wrong.append("a message is not the one that was written")
    if flushed and what != "power lost":  # it is not said that a recording is synchronised
        _, number, gaps = flushed[-1]
        promised = {n for n in range(number + 1) if n < _MESSAGES}
        missing = promised - {*found}
        if len(missing) > gaps:
            wrong.append(f"{len(missing)} messages are missing, told were {gaps}: {bag.damage}")
    if not (told and told[-1][0] == "closed") and not bag.damage:
        wrong.append(f"it was not closed, and nobody says so: {len(found)} messages")
    return wrong


SUBJECTS: Final = {
    "history": Subject(60, _nothing, _write_history, _check_history),
    "calibration": Subject(8, _prepare_calibration, _write_calibration, _check_calibration),
    "result": Subject(10, _prepare_result, _write_result, _check_result),
    "bag": Subject(60, _nothing, _write_bag, _check_bag),
}
"""What is written, by name."""


def trial(rng: np.random.Generator, counts: Counter[str]) -> str:
    """Do a trial; return what does not hold, empty when all does."""
    name = str(rng.choice(list(SUBJECTS)))
    what = str(rng.choice(list(KINDS)))
    subject = SUBJECTS[name]
    first = int(rng.integers(1, subject.changes + 1))
    many = int(rng.choice([1, 3, 20, 10**9]))
    with tempfile.TemporaryDirectory(prefix="files_") as path:
        folder = Path(path)
        subject.prepare(folder)
        read, write = os.pipe()
        child = os.fork()
        if not child:
            _work(subject, folder, write, (KINDS[what], first, many))
        os.close(write)
        lines, status = _told(child, read)
        told = [json.loads(line) for line in lines]
        was_hit = any(item[0] == "hit" for item in told) or os.WIFSIGNALED(status)
        raised = [item[1] for item in told if item[0] == "raised"]
        told = [item for item in told if item[0] not in ("hit", "raised")]
        counts[f"{name}: {what if was_hit else 'nothing failed'}"] += 1
        wrong = [f"raised {words}" for words in raised]
        if os.WIFSIGNALED(status) and what not in _DIES:
            wrong.append(f"ended by {signal.Signals(os.WTERMSIG(status)).name}")
        try:
            wrong += subject.check(folder, told, what)
        except Exception as error:
            wrong.append(f"cannot be read: {error!r}")
    begins = f"{name}, {what} at change {first}, {many} of them: "
    return begins + "; ".join(wrong) if wrong else ""


def _work(subject: Subject, folder: Path, write: int, plan: tuple[int, int, int]) -> None:
    """Write in a child, whose files fail by a plan."""
    faulty = ctypes.CDLL(None)

    def tell(item: Any) -> None:
        os.write(write, json.dumps(item).encode() + b"\n")

    kind, first, many = plan
    faulty.faulty_arm(str(folder).encode(), kind, ctypes.c_long(first), ctypes.c_long(many))
    try:
        subject.work(folder, tell)
    except BaseException as error:
        tell(["raised", repr(error)])
    faulty.faulty_end()
    if faulty.faulty_hit():
        tell(["hit"])
    os._exit(0)


def _told(child: int, read: int) -> tuple[list[bytes], int]:
    """Return what a child told, and how it ended; one that hangs is killed."""
    data, end_s = b"", time.monotonic() + _HANGS_S
    while True:
        ready, _, _ = select.select([read], [], [], max(end_s - time.monotonic(), 0.0))
        if not ready:
            os.kill(child, signal.SIGABRT)
            break
        part = os.read(read, 65536)
        if not part:
            break
        data += part
    os.close(read)
    return data.splitlines(), os.waitpid(child, 0)[1]


def main() -> None:
    """Do the trials and write what was found."""
    seed, case, trials = map(int, sys.argv[1:4])
    counts: Counter[str] = Counter()
    failures = []
    Calibration.builtin()
    for number in range(trials):
        if wrong := trial(np.random.default_rng([seed, case, number]), counts):
            failures.append(f"trial {number}: {wrong}")
    Path(sys.argv[4]).write_text(json.dumps({"counts": counts, "failures": failures}))


if __name__ == "__main__":
    main()
