# SPDX-License-Identifier: Apache-2.0
"""Restart of a monitor: time from a unit's history of many tests to its health.

    python resume.py [--tests 1000] [--runs 5] [--json FILE]

Prints the time with the stored growth, and the time if all tests are repeated, as after a change of
limits or of the tracker.
"""

import sqlite3
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Final

import numpy as np
from prognosis.whole import worn
from script import Figures, Workers, command
from targets import Row, at_most, untargeted

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.requirements.requirements import RequirementLimits, requirements_of
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

MOST_S: Final = 0.5
UNIT: Final = ("flap", "drawn")
SETTINGS: Final = PrognosisSettings(service=Service(hours_per_cycle=1.0))


def lived(path: Path, tests: int) -> None:
    """Write the history of a unit with growing friction and backlash to a file."""
    unit, rng = Unit(History(*UNIT, path), SETTINGS), np.random.default_rng(1)
    for number in range(tests):
        unit.update(worn(float(number), number / tests, rng), None, SETTINGS)
        unit.write()
    unit.history.close()


def resume_s(path: Path) -> float:
    """Return the time to read a history and compute the health after its latest test [s]."""
    parameters = Calibration.builtin().unit_parameters
    start_s = time.perf_counter()
    unit = Unit(History(*UNIT, path), SETTINGS)
    outlook = unit.resume(parameters, SETTINGS)
    taken_s = time.perf_counter() - start_s
    if outlook is None or unit.history.problem:
        raise RuntimeError(f"no health from {path}: {unit.history.problem}")
    unit.history.close()
    return taken_s


def measure(_: Workers, tests: int, runs: int) -> Figures:
    """Measure the time of a restart with the stored growth, and without it."""
    # A process compiles the requirements once, for its first unit: exclude that time.
    requirements_of(Calibration.builtin().unit_parameters, RequirementLimits())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "unit.sqlite"
        lived(path, tests)
        kept = [resume_s(path) for _ in range(runs)]
        with closing(sqlite3.connect(path)) as db, db:
            db.execute("DELETE FROM growth")
        repeated = [resume_s(path) for _ in range(runs)]
    kept_s, repeated_s = statistics.median(kept), statistics.median(repeated)
    return {"tests": tests, "kept_s": kept_s, "repeated_s": repeated_s}


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    kept_s, repeated_s = figures["kept_s"], figures["repeated_s"]
    what = f"restart with a history of {figures['tests']} tests, to its health [s]"
    yield at_most(what, kept_s, MOST_S)
    again = f"{repeated_s:.2f}, {repeated_s / kept_s:.0f} times as long"
    yield untargeted("  when all tests are repeated [s]", again)


main = command(measure, "restart", rows, tests=1000, runs=5)

if __name__ == "__main__":
    main()
