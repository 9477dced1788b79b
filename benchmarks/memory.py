"""Peak memory of the commands that read bags, on a bag of one minute and one of ten.

python memory.py [--minutes 1 10]
"""

import argparse
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

import click
from click.testing import CliRunner

from ema_cli.main import main

CYCLE_S: Final = 1.7
COMMANDS: Final = ("info", "calibrate", "plot", "compare")


def peak_mib(bag: Path, command: str) -> float:
    """Return the largest resident set of a command in a process of its own [MiB].

    Parameters
    ----------
    bag
        The bag that it reads.
    command
        Name of the command.
    """
    output = bag.with_suffix(".yaml" if command == "calibrate" else ".png")
    options = {"info": [], "compare": ["--algorithms", "least_squares"], "calibrate": ["--force"]}
    arguments = [command, str(bag), *options.get(command, [])]
    arguments += [] if command == "info" else ["-o", str(output)]
    child = subprocess.Popen(
        [sys.executable, "-c", "from ema_cli.main import main; main()", *arguments],
        stdout=subprocess.DEVNULL,
    )
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise click.ClickException(f"ema {' '.join(arguments)} ended with {child.returncode}")
    return usage.ru_maxrss / 1024.0


def measure(minutes: list[float]) -> None:
    """Print the peak of each command for bags of some lengths."""
    with tempfile.TemporaryDirectory() as folder:
        bags = []
        for length in minutes:
            bag = Path(folder) / f"{length:g}.mcap"
            cycles = str(math.ceil(60.0 * length / CYCLE_S))
            CliRunner().invoke(main, ["simulate", "--cycles", cycles, "-o", str(bag)])
            bags.append(bag)
        for command in COMMANDS:
            peaks = [peak_mib(bag, command) for bag in bags]
            row = ", ".join(
                f"{peak:.0f} MiB for {length:g} min"
                for peak, length in zip(peaks, minutes, strict=True)
            )
            print(f"peak memory of ema {command}: {row}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=[1.0, 10.0])
    measure(parser.parse_args().minutes)
