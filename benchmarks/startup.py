"""Start-up: processor and wall time of short commands, run again and again with warm caches.

python startup.py [--runs 9] [--json FILE]
"""

import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

import click
from rich.console import Console
from tables import target_table
from targets import Row

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
        Row(
            f"ema {command}, median of wall (processor) time [s]",
            f"<= {limit_s:g}",
            f"{figures[command]['wall_s']:.2f} ({figures[command]['processor_s']:.2f})",
            figures[command]["wall_s"] <= limit_s,
        )
        for command, limit_s in TARGETS_S.items()
    ]


@click.command()
@click.option("--runs", default=9, show_default=True, type=click.IntRange(1))
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(runs: int, output: Path | None) -> None:
    """Print how long short commands take."""
    figures = {}
    for command in TARGETS_S:
        run_once(command)  # fills the caches
        times = [run_once(command) for _ in range(runs)]
        processor_s, wall_s = (statistics.median(column) for column in zip(*times, strict=True))
        figures[command] = {"processor_s": processor_s, "wall_s": wall_s}
    Console(width=140).print(target_table("start-up", rows(figures)))
    if output is not None:
        output.write_text(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
