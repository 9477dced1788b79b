"""Peak memory of the commands that read bags, on a bag of one minute and one of ten.

python memory.py [--json FILE]
"""

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

import click
from click.testing import CliRunner
from rich.console import Console
from tables import target_table
from targets import Row

from ema_cli.main import main as ema

CYCLE_S: Final = 1.7
MINUTES: Final = (1, 10)
OPTIONS: Final = {
    "info": (),
    "estimate": ("--json",),
    "plot": ("-o", "plot.png"),
    "calibrate": ("--replace", "-o", "calibration.yaml"),
}
CHILD: Final = """
import atexit
from pathlib import Path
atexit.register(lambda: Path("status").write_text(Path("/proc/self/status").read_text()))
from ema_cli.main import main
main()
"""
MOST: Final = 1.1
"""How much larger the peak may be with the longer bag: windows are kept, their telemetry is not."""


def peak_mib(bag: Path, command: str) -> float:
    """Return the largest resident set of a command in a process of its own [MiB]."""
    arguments = [command, str(bag), *OPTIONS[command]]
    done = subprocess.run(
        [sys.executable, "-c", CHILD, *arguments],
        stdout=subprocess.DEVNULL,
        cwd=bag.parent,
        check=False,
    )
    if done.returncode:
        raise click.ClickException(f"ema {' '.join(arguments)} ended with {done.returncode}")
    # Not what wait4 returns: that is at least the peak of the process that forked.
    status = (bag.parent / "status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024.0


def rows(figures: dict[str, list[float]]) -> list[Row]:
    """Return the rows of the table: the peak of each command with the short and the long bag."""
    short_min, long_min = MINUTES
    return [
        Row(
            f"ema {command}, peak memory with {long_min} min over that with {short_min} min",
            f"<= {MOST:g}",
            f"{long / short:.2f} ({short:.0f} and {long:.0f} MiB)",
            long <= MOST * short,
        )
        for command, (short, long) in figures.items()
    ]


@click.command()
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(output: Path | None) -> None:
    """Print the peak memory of each command for a short and a long bag."""
    figures: dict[str, list[float]] = {command: [] for command in OPTIONS}
    with tempfile.TemporaryDirectory() as folder:
        for minutes in MINUTES:
            bag = Path(folder) / f"{minutes}.mcap"
            cycles = str(math.ceil(60.0 * minutes / CYCLE_S))
            arguments = ["simulate", "--cycles", cycles, "-o", str(bag)]
            CliRunner().invoke(ema, arguments, catch_exceptions=False)
            for command, peaks in figures.items():
                peaks.append(peak_mib(bag, command))
    Console(width=140).print(target_table("memory", rows(figures)))
    if output is not None:
        output.write_text(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
