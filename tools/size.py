#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Print the size of the repository in lines and packages, for information (`make size`)."""

import statistics
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
MONITOR: Final = "ema_monitor/ema_monitor/"


class Row(NamedTuple):
    """Name and value of a size."""

    measure: str
    value: float


def tracked(*patterns: str) -> list[Path]:
    """Return the tracked files whose paths match any of the patterns."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", *patterns],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        encoding="utf-8",
    )
    paths = [ROOT / name for name in listed.stdout.split("\0") if name]
    return [path for path in paths if path.is_file() and not path.is_symlink()]


def lines(paths: Iterable[Path]) -> int:
    """Return the total number of lines in files."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def measured() -> list[Row]:
    """Return the sizes of the repository."""
    production = tracked("ema_*/*.py", "ros2_ws/*.py")
    sizes = [lines([path]) for path in production]
    packages = [
        path.parent.name
        for path in tracked("*package.xml")
        if path.parent.name not in ("ema_interfaces", "ema_bringup")
    ]
    return [
        Row("production Python, lines", sum(sizes)),
        Row("  in ema_monitor", lines(tracked(f"{MONITOR}*.py"))),
        Row("tests, lines", lines(tracked("tests/*.py"))),
        Row("benchmarks, lines", lines(tracked("benchmarks/*.py"))),
        Row("packages except ema_interfaces and ema_bringup", len(packages)),
        Row("median lines of a file", statistics.median(sizes)),
        Row("largest file, lines", max(sizes)),
    ]


def main() -> None:
    """Print the sizes as a table."""
    for measure, value in measured():
        print(f"{measure:58}{value:>10,.0f}")


if __name__ == "__main__":
    main()
