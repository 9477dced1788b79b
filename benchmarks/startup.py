# SPDX-License-Identifier: Apache-2.0
"""Start-up: processor and wall time of short commands, run repeatedly with warm caches.

python startup.py [--runs 9] [--json FILE]
"""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from script import Figures, Workers, command
from targets import Row, at_most

SAMPLE: Final = Path(__file__).parents[1] / "bags" / "faulty_flap.mcap"
TARGETS_S: Final = {"--help": 0.3, "info": 0.3, "estimate": 0.8}
"""Largest wall time of each command on an idle machine [s]."""


def run_once(name: str) -> tuple[float, float]:
    """Return the processor time and the wall time of a command in a new process [s]."""
    arguments = [name] if name == "--help" else [name, str(SAMPLE)]
    # As in a user's shell: Python keeps compiled modules.
    unset = ("PYTHONDONTWRITEBYTECODE", "PYTHONUNBUFFERED")
    before_s, begin_s = children_s(), time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", "from ema_ros.programs import ema; ema()", *arguments],
        env={name: value for name, value in os.environ.items() if name not in unset},
        stdout=subprocess.DEVNULL,
        check=True,
    )
    return children_s() - before_s, time.perf_counter() - begin_s


def children_s() -> float:
    """Return the processor time of all ended child processes [s]."""
    times = os.times()
    return times.children_user + times.children_system


def measure(_: Workers, runs: int) -> Figures:
    """Measure the median time of short commands."""
    figures = {}
    for name in TARGETS_S:
        run_once(name)  # fills the caches
        times = [run_once(name) for _ in range(runs)]
        processor_s, wall_s = (statistics.median(column) for column in zip(*times, strict=True))
        figures[name] = {"processor_s": processor_s, "wall_s": wall_s}
    return figures


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets, which are for the wall time on an idle machine."""
    for name, limit_s in TARGETS_S.items():
        wall_s, processor_s = figures[name]["wall_s"], figures[name]["processor_s"]
        what = f"ema {name}, median of wall (processor) time [s]"
        yield at_most(what, wall_s, limit_s, f"{wall_s:.2f} ({processor_s:.2f})")


main = command(measure, "start-up", rows, runs=9)

if __name__ == "__main__":
    main()
