#!/usr/bin/env python3
"""How large the repository is, against its bounds: `make size`. Fails where a bound is passed."""

import re
import statistics
import subprocess
import sys
from collections.abc import Iterable
from itertools import combinations
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
MONITOR: Final = "ema_monitor/ema_monitor/"


class Row(NamedTuple):
    """A measure, what it is to come to, and beyond what it fails; None where nothing is asked."""

    what: str
    value: float
    target: int | None = None
    most: int | None = None


def tracked(*patterns: str) -> list[Path]:
    """Return the files that git tracks, by patterns of their paths."""
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
    """Return how many lines files have."""
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def circles() -> list[tuple[str, str]]:
    """Return the pairs of folders of ema_monitor that import each other."""
    known: dict[str, set[str]] = {}
    for path in tracked(f"{MONITOR}*.py"):
        folder, *rest = path.relative_to(ROOT / MONITOR).parts
        if rest:
            text = path.read_text(encoding="utf-8")
            known.setdefault(folder, set()).update(re.findall(r"from ema_monitor\.(\w+)[. ]", text))
    return [
        (one, other)
        for one, other in combinations(sorted(known), 2)
        if other in known[one] and one in known[other]
    ]


def measured() -> list[Row]:
    """Return all measures."""
    production = tracked("ema_*/*.py", "ros2_ws/*.py")
    sizes = [lines([path]) for path in production]
    packages = [
        path.parent.name
        for path in tracked("*package.xml")
        if path.parent.name not in ("ema_interfaces", "ema_bringup")
    ]
    pairs = circles()
    return [
        Row("production Python, lines", sum(sizes)),
        Row("  of it ema_monitor", lines(tracked(f"{MONITOR}*.py"))),
        Row("tests, lines", lines(tracked("tests/*.py"))),
        Row("benchmarks, lines", lines(tracked("benchmarks/*.py"))),
        Row("packages beside ema_interfaces and ema_bringup", len(packages), 9, 9),
        Row("pairs of folders of ema_monitor that import each other", len(pairs), 0, 0),
        Row("median lines of a file", statistics.median(sizes), 220),
        Row("largest file, lines", max(sizes), 650, 650),
    ]


def main() -> int:
    """Print the table; return 1 where a bound is passed."""
    is_within = True
    print(f"{'':58}{'now':>8}{'target':>8}{'bound':>8}")
    for what, value, target, most in measured():
        cells = (f"{value:,.0f}", *("" if one is None else f"{one:,}" for one in (target, most)))
        mark = "  passed" if most is not None and value > most else ""
        is_within &= not mark
        print(f"{what:58}" + "".join(f"{cell:>8}" for cell in cells) + mark)
    for one, other in circles():
        print(f"  {one} and {other} import each other")
    return 0 if is_within else 1


if __name__ == "__main__":
    sys.exit(main())
