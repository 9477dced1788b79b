"""An archive whose workers, and whose run, are killed at random moments: its tables are whole.

``ema archive run`` with two workers, of which one, or now and then the run itself, is killed. A run
that was killed leaves no worker; the next one goes on. At the end all tables have, to the bit, the
rows of an archive of the same bags in which nothing was killed.
"""

import contextlib
import math
import os
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from part import Case

from ema_archive.manifest import Manifest
from ema_archive.query import answer
from ema_archive.running import scan
from ema_cli.errors import REFUSED
from ema_cli.lives.files import write_test
from ema_cli.lives.tests_of_life import calibration_of_life, simulated_tests, unit_of_life
from ema_cli.processes.stop_request import StopRequest
from ema_core.faults import fault_vector
from ema_sim.lives import SimulatedLife

VICTIMS: Final = ("archive worker", "archive run")
KILLS: Final = 5

_OF_RUN: Final = 0.25
_TESTS: Final = 8
_KINDS: Final = ("friction", "backlash")
_LONGEST_WAIT_S: Final = 2.0
_ENDS_WITHIN_S: Final = 20.0
_RUN_S: Final = 120.0
_TABLES: Final = ("estimates", "usage", "health")


def run(case: Case, kills: int = KILLS) -> None:
    """Kill so many processes that bring an archive up to date, and check its tables."""
    bags, archive, whole = (case.folder / name for name in ("bags", "archive", "undisturbed"))
    _make_bags(bags)
    for folder in (archive, whole):
        with Manifest(folder, is_new=True) as manifest:
            scan(manifest, [str(bags)])
    with _started(whole, "--executor", "threads") as command:
        code = command.wait(_RUN_S)
    case.require(code == 0, f"ema archive run of an undisturbed archive ended with code {code}")
    rng = case.rng(1)
    left = kills
    while left:
        left -= _run_and_kill(case, archive, rng, left)
        # So that the next run has something to do.
        _touch(bags, archive)
    _finish(case, bags, archive)
    for name in _TABLES:
        expected, found = _rows(whole, name), _rows(archive, name)
        case.require(bool(expected), f"table {name} of an undisturbed archive is empty")
        case.require(
            found == expected,
            f"table {name} after {kills} kills has {len(found)} rows, "
            f"{len(set(found) ^ set(expected))} of them are not those of an undisturbed archive, "
            f"which has {len(expected)}",
        )
        case.count("rows of archives compared", len(found))


def _make_bags(bags: Path) -> None:
    hours = np.array([300.0 * (test + 1) for test in range(_TESTS)])
    for number, kind in enumerate(_KINDS):
        faults = np.array([fault_vector({kind: 0.05 + 0.03 * test}) for test in range(_TESTS)])
        life = SimulatedLife(kind, {}, hours, faults, ("good",) * _TESTS, math.inf)
        unit = replace(unit_of_life(0, number), actuator_id=f"flap_{number}")
        folder = bags / f"unit_{number}"
        folder.mkdir(parents=True)
        calibration = replace(calibration_of_life(unit), actuator_id=unit.actuator_id)
        calibration.save(folder / "calibration.yaml")
        generator = np.random.default_rng(number)
        for test in simulated_tests(life, unit, generator, StopRequest()):
            write_test(folder / f"{test.number}.mcap", test, unit)


def _run_and_kill(case: Case, archive: Path, rng: np.random.Generator, most: int) -> int:
    """Run, and kill until it ends; return how many were killed."""
    kills = 0
    with _started(archive) as command:
        while kills < most:
            end_s = time.monotonic() + rng.uniform(0.0, _LONGEST_WAIT_S)
            while time.monotonic() < end_s and command.poll() is None:
                time.sleep(0.01)
            workers = _workers(command.pid)
            if command.poll() is not None:
                break
            if rng.random() < _OF_RUN:
                command.kill()
                command.wait()
                case.count("kills of archive run")
                _require_end(case, workers)
                return kills + 1
            if workers:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(int(rng.choice(workers)), signal.SIGKILL)
                    case.count("kills of archive worker")
                    kills += 1
        code = command.wait(_RUN_S)
    # Bags are given up when three workers were killed while they worked on them.
    case.require(code in (0, REFUSED), f"ema archive run ended with code {code}")
    return kills


def _started(archive: Path, *options: str) -> subprocess.Popen[bytes]:
    words = ("ema", "archive", "run", str(archive), "--workers", "2", *options)
    return subprocess.Popen(words, stdout=subprocess.DEVNULL)


def _workers(pid: int) -> list[int]:
    """Return the processes that a run has started for tasks."""
    found = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            for child in task.read_text().split():
                if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                    found.append(int(child))
    return found


def _require_end(case: Case, pids: list[int]) -> None:
    """Require that processes end soon."""
    end_s = time.monotonic() + _ENDS_WITHIN_S
    while any(_lives(pid) for pid in pids) and time.monotonic() < end_s:
        time.sleep(0.05)
    left = [pid for pid in pids if _lives(pid)]
    case.require(
        not left,
        f"{len(left)} workers of a killed run live {_ENDS_WITHIN_S:g} s later, expected none",
    )


def _lives(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def _touch(bags: Path, archive: Path) -> None:
    for path in bags.rglob("*.mcap"):
        os.utime(path)
    with Manifest(archive) as manifest:
        scan(manifest, [])


def _finish(case: Case, bags: Path, archive: Path) -> None:
    """Run until nothing is due: a bag that lost three workers is done by the next run."""
    codes = []
    for _ in range(2):
        with _started(archive) as command:
            codes.append(command.wait(_RUN_S))
    case.require(
        codes[-1] == 0, f"ema archive run ended with code {codes[-1]} when nothing was killed"
    )
    with Manifest(archive) as manifest:
        due = manifest.find_due(manifest.settings)
    count = sum(1 for _ in bags.rglob("*.mcap"))
    case.require(due == 0, f"{due} of {count} bags are due after a whole run, expected none")


def _rows(archive: Path, name: str) -> list[str]:
    """Return the rows of a table as texts that show every bit, and in which NaN equals itself."""
    timed = " exclude (computing_time_s)" if name == "estimates" else ""
    return [repr(row) for row in answer(archive, f"select *{timed} from {name} order by all")[1]]
