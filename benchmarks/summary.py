# SPDX-License-Identifier: Apache-2.0
"""All targets in one table, from the files of the other benchmarks.

    python benchmarks/summary.py

Reads the JSON files that `make bench` writes to this folder. Prints the table, writes it to
summary.json and appends it to history.csv with the commit. Fails if a target is missed.
"""

import csv
import json
import subprocess
from importlib import import_module
from pathlib import Path
from typing import Final

from prognosis.own_laws import BESIDE
from rich.console import Console
from targets import Row, target_table

HERE: Final = Path(__file__).parent
SCRIPTS: Final = (
    *("accuracy", "field_oriented", "trust", "sensor_errors", "sampling", "design"),
    *("ordinary_motion", "departures", "joints", "kernels", "live", "many_actuators"),
    *(
        "many_joints",
        "learning",
        "promptness",
        "dashboard",
        "startup",
        "resume",
        "memory",
        "archive",
    ),
    *("prognosis.own_laws", "prognosis.foreign_laws", "advisory"),
)
"""Modules with targets; each writes a JSON file with its name."""


def main() -> None:
    """Print and write the table of all targets. Exit with status 0, or 1 if a target is missed."""
    rows: list[Row] = []
    for name in SCRIPTS:
        file = HERE / f"{name.rpartition('.')[2]}.json"
        rows += import_module(name).rows(json.loads(file.read_text(encoding="utf-8")))
    Console(width=140).print(target_table("targets", rows, f"thesis, or\n{BESIDE}"))
    content = [row._asdict() | {"met": None if row.met is None else bool(row.met)} for row in rows]
    (HERE / "summary.json").write_text(json.dumps(content, indent=2), encoding="utf-8")
    words = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(
        words, cwd=HERE, capture_output=True, text=True, check=True, encoding="utf-8"
    ).stdout
    with (HERE / "history.csv").open("a", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows((commit.strip(), row.what, row.measured) for row in rows)
    missed = sum(row.met is False for row in rows)
    raise SystemExit(f"{missed} targets missed" if missed else 0)


if __name__ == "__main__":
    main()
