# SPDX-License-Identifier: Apache-2.0
"""Peak memory of the commands that read bags, for a bag of one minute and a bag of ten minutes.

python memory.py [--json FILE]
"""

import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from click.testing import CliRunner
from script import Figures, Workers, command, peak_mib
from targets import Row, at_most

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
"""Largest ratio of the peaks of the longer and the shorter bag [-].

Commands keep the windows in memory, but not the telemetry.
"""


def peak_of(bag: Path, name: str) -> float:
    """Run a command in a new process. Return its largest resident set [MiB]."""
    arguments = [sys.executable, "-c", CHILD, name, str(bag), *OPTIONS[name]]
    subprocess.run(arguments, stdout=subprocess.DEVNULL, cwd=bag.parent, check=True)
    return peak_mib((bag.parent / "status").read_text(encoding="utf-8"))


def measure(pool: Workers) -> Figures:
    """Measure the peak memory of each command for a short and a long bag."""
    figures: Figures = {name: [] for name in OPTIONS}
    with tempfile.TemporaryDirectory() as folder:
        for minutes in pool.track("bags", MINUTES):
            bag = Path(folder) / f"{minutes}.mcap"
            cycles = str(math.ceil(60.0 * minutes / CYCLE_S))
            arguments = ["simulate", "--cycles", cycles, "-o", str(bag)]
            CliRunner().invoke(ema, arguments, catch_exceptions=False)
            for name, peaks in figures.items():
                peaks.append(peak_of(bag, name))
    return figures


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets: the ratio of the peaks of each command."""
    short_min, long_min = MINUTES
    for name in OPTIONS:
        short, long = figures[name]
        what = f"ema {name}, peak memory with {long_min} min over that with {short_min} min"
        measured = f"{long / short:.2f} ({short:.0f} and {long:.0f} MiB)"
        yield at_most(what, long / short, MOST, measured)


main = command(measure, "memory", rows)

if __name__ == "__main__":
    main()
