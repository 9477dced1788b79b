# SPDX-License-Identifier: Apache-2.0
"""Compare a benchmark of another commit with the same benchmark of the working tree, in turns.

    python commits.py COMMIT SCRIPT [--turns 3] [ARGUMENTS OF THE SCRIPT]

Each tree runs its own version of the script, with the libraries and messages of this workspace.
Prints the median of each figure in both trees, and the median ratio of working tree to commit
within a turn.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import click
from rich.console import Console
from targets import grid

ROOT: Final = Path(__file__).parents[1]


def measured(root: Path, script: str, arguments: tuple[str, ...]) -> dict[str, float]:
    """Run a script of a source tree. Return its figures by name."""
    packages = [*root.glob("ema_*"), *root.glob("ros2_ws/src/ema_*")]
    path = os.pathsep.join([*map(str, packages), os.environ.get("PYTHONPATH", "")])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "figures.json")
        words = [sys.executable, f"{script}.py", *arguments, "--json", str(file)]
        where = {"cwd": root / "benchmarks", "env": os.environ | {"PYTHONPATH": path}}
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, **where)
        return dict(numbers(json.loads(file.read_text(encoding="utf-8"))))


def numbers(figures: dict[str, Any], name: str = "") -> Iterator[tuple[str, float]]:
    """Yield the name and value of each number in nested figures; keys are joined by spaces."""
    for key, value in figures.items():
        if isinstance(value, dict):
            yield from numbers(value, f"{name}{key} ")
        elif isinstance(value, int | float):
            yield f"{name}{key}", float(value)


@click.command(context_settings={"ignore_unknown_options": True}, help=__doc__)
@click.argument("commit")
@click.argument("script")
@click.option("--turns", default=3, show_default=True)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def main(commit: str, script: str, turns: int, arguments: tuple[str, ...]) -> None:
    """Print the median of each figure that both trees have, and the median ratio."""
    with tempfile.TemporaryDirectory() as folder:
        checkout = Path(folder, "other")
        worktree = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*worktree, "add", "--quiet", "--detach", checkout, commit], check=True)
        try:
            trees = [(checkout, ROOT)] * turns
            times = [[measured(tree, script, arguments) for tree in both] for both in trees]
        finally:
            subprocess.run([*worktree, "remove", "--force", checkout], check=True)
    rows = []
    for name in times[0][0].keys() & times[0][1].keys():
        before, now = zip(*([entry[name] for entry in both] for both in times), strict=True)
        ratios = [b / a if a else float("nan") for a, b in zip(before, now, strict=True)]
        rows.append((name, *map(statistics.median, (before, now, ratios))))
    headings = ("what", commit, "now", "ratio")
    Console(width=120).print(grid(f"{script}, {turns} turns", headings, sorted(rows), digits=3))


if __name__ == "__main__":
    main()
