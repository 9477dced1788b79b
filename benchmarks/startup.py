"""Start-up: processor and wall time of short commands, run again and again with warm caches.

python startup.py [--runs 9] [--json FILE]
"""

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Final

import click
from rich.progress import Progress
from tables import target_shower
from targets import Row, at_most
from trials import command

SAMPLE: Final = Path(__file__).parents[1] / "bags" / "faulty_flap.mcap"
TARGETS_S: Final = {"--help": 0.3, "info": 0.3, "estimate": 0.8}
"""Commands, and how long each may take on an idle machine [s]."""


def run_once(command: str) -> tuple[float, float]:
    """Return the processor time and the wall time of a command in a process of its own [s]."""
    arguments = [command] if command == "--help" else [command, str(SAMPLE)]
    # As a user's shell has it: compiled modules are kept.
    unset = ("PYTHONDONTWRITEBYTECODE", "PYTHONUNBUFFERED")
    begin_s = time.perf_counter()
    child = subprocess.Popen(
        [sys.executable, "-c", "from ema_cli.main import main; main()", *arguments],
        env={name: value for name, value in os.environ.items() if name not in unset},
        stdout=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(child.pid, 0)
    wall_s = time.perf_counter() - begin_s
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise click.ClickException(f"ema {command} ended with {child.returncode}")
    return usage.ru_utime + usage.ru_stime, wall_s


def rows(figures: dict[str, dict[str, float]]) -> list[Row]:
    """Return the rows of the table: what counts is the wall time, of an idle machine."""
    return [
        at_most(
            f"ema {name}, median of wall (processor) time [s]",
            figures[name]["wall_s"],
            limit_s,
            f"{figures[name]['wall_s']:.2f} ({figures[name]['processor_s']:.2f})",
        )
        for name, limit_s in TARGETS_S.items()
    ]


def measure(_: Progress, runs: int) -> dict[str, Any]:
    """Print how long short commands take, the median of so many runs."""
    figures = {}
    for name in TARGETS_S:
        run_once(name)  # fills the caches
        times = [run_once(name) for _ in range(runs)]
        processor_s, wall_s = (statistics.median(column) for column in zip(*times, strict=True))
        figures[name] = {"processor_s": processor_s, "wall_s": wall_s}
    return figures


main = command(measure, target_shower("start-up", rows), runs=9)

if __name__ == "__main__":
    main()
