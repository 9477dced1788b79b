"""Peak memory of the commands that read bags, on a bag of one minute and one of ten.

python memory.py [--json FILE]
"""

import math
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import click
from click.testing import CliRunner
from rich.progress import Progress
from tables import target_shower
from targets import Row, at_most
from trials import command

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


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows of the table: the peak of each command with the short and the long bag."""
    short_min, long_min = MINUTES
    found = []
    for name in OPTIONS:
        short, long = figures[name]
        what = f"ema {name}, peak memory with {long_min} min over that with {short_min} min"
        measured = f"{long / short:.2f} ({short:.0f} and {long:.0f} MiB)"
        found.append(at_most(what, long / short, MOST, measured))
    return found


def measure(progress: Progress) -> dict[str, Any]:
    """Print the peak memory of each command for a short and a long bag."""
    figures: dict[str, Any] = {name: [] for name in OPTIONS}
    with tempfile.TemporaryDirectory() as folder:
        for minutes in progress.track(MINUTES, description="bags"):
            bag = Path(folder) / f"{minutes}.mcap"
            cycles = str(math.ceil(60.0 * minutes / CYCLE_S))
            arguments = ["simulate", "--cycles", cycles, "-o", str(bag)]
            CliRunner().invoke(ema, arguments, catch_exceptions=False)
            for name, peaks in figures.items():
                peaks.append(peak_mib(bag, name))
    return figures


main = command(measure, target_shower("memory", rows))

if __name__ == "__main__":
    main()
