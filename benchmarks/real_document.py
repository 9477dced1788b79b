# SPDX-License-Identifier: Apache-2.0
"""Write the tables of docs/real-data.md from the figures of `real.py`.

    python benchmarks/real_document.py FIGURES [--write DOCUMENT] [--picture FILE]

FIGURES is the file of `real.py --json`. The tables are printed in Markdown. With --write, each
table replaces the table of DOCUMENT with the same headings.
"""

import json
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Final

import click
import numpy as np
from real import (
    DAYS,
    HEALTHY,
    LOADS,
    PUBLISHED,
    REPORTED,
    chosen,
    draw,
    has_departed,
    is_blind,
    kind,
    named,
    smallest_change,
)
from script import Figures

STATES: Final = {
    "healthy": (HEALTHY,),
    "lubrication 1": ("lackLubrication1",),
    "lubrication 2": ("lackLubrication2",),
    "backlash 1": ("backlash1",),
    "backlash 2": ("backlash2",),
    "spalling 7": ("spalling7",),
    "spalling 8": ("spalling8",),
    "spalling 1 to 6": tuple(f"spalling{severity}" for severity in range(1, 7)),
}
COEFFICIENTS: Final = {
    "inertia": ("mass", "kg"),
    "viscous friction": ("viscous friction", "N.s/m"),
    "friction": ("Coulomb friction", "N"),
    "constant load": ("constant load", "N"),
}
LOAD_N: Final = -3.16
"""Published constant load of EMPS [N]."""
PERIODS: Final = {
    "31 July, marked by its authors": ("2017-07-31", "2017-07-31"),
    "September, device removed": ("2017-09-01", "2017-09-30"),
    "2 to 4 October, no lubricant": ("2017-10-02", "2017-10-04"),
    "9 to 12 October": ("2017-10-09", "2017-10-12"),
}


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    lines = [headings, ["---"] * len(headings), *rows]
    return [f"| {' | '.join(cells)} |".replace("|  |", "| |") for cells in lines]


def tables(figures: Figures) -> Iterator[list[str]]:
    """Yield the tables of the document."""
    loads = [f"{load} kg" for load in LOADS]
    yield table(
        ["state", *loads],
        [
            [name, *(_departed(figures, load, states) for load in LOADS)]
            for name, states in STATES.items()
        ],
    )
    yield table(
        ["healthy days, smallest detectable change of friction", *loads],
        [
            [str(days), *(f"{smallest_change(figures, days, load):.2g} %" for load in LOADS)]
            for days in DAYS
        ],
    )
    names = {STATES[name][0]: name for name in STATES} | {"spalling4": "spalling 4"}
    yield table(
        ["level after one healthy day", *loads],
        [
            [names[state], *(_level(figures, load, state) for load in LOADS)]
            for state in (HEALTHY, *REPORTED)
        ],
    )
    yield table(
        ["labelled trials, named rightly", *loads],
        [
            ["state, of thirteen", *(_right(figures, load) for load in LOADS)],
            ["kind, of four", *(_right(figures, load, are_kinds=True) for load in LOADS)],
        ],
    )
    if "emps" in figures:
        yield from _emps_tables(figures["emps"])
    for tests in figures["aircraft"].values():
        yield table(
            ["test", "times healthy", "level", "days to 1.5 times healthy: 5, 50, 95 %"],
            [_period(name, tests) for name in PERIODS],
        )


def _departed(figures: Figures, load: int, states: tuple[str, ...]) -> str:
    """Return the number of departed trials for each number of days, and the number of trials."""
    tests = [chosen(figures, days, load, *states) for days in DAYS]
    departed = [sum(map(has_departed, of_days)) for of_days in tests]
    sizes = [len(of_days) for of_days in tests]
    if len(set(sizes)) == 1:
        return f"{' / '.join(map(str, departed))} of {sizes[0]}"
    pairs = zip(departed, sizes, strict=True)
    return " / ".join(f"{count} of {size}" for count, size in pairs)


def _level(figures: Figures, load: int, state: str) -> str:
    (report,) = (
        report
        for report in figures["reports"]
        if report["load"] == load and report["state"] == state
    )
    return report["level"] + (" (blind)" if report["level"] == "OK" and is_blind(report) else "")


def _right(figures: Figures, load: int, *, are_kinds: bool = False) -> str:
    tests = [test for test in figures["trials"] if test["labelled"] and test["load"] == load]
    pairs = [(named(test), test["state"]) for test in tests]
    if are_kinds:
        pairs = [(kind(name), kind(state)) for name, state in pairs]
    right = sum(name == state for name, state in pairs)
    return f"{right} of {len(pairs)} ({100.0 * right / len(pairs):.0f} %)"


def _emps_tables(emps: Figures) -> Iterator[list[str]]:
    published = PUBLISHED | {"constant load": LOAD_N}
    yield table(
        ["coefficient", "published", "`ema calibrate`"],
        [
            [label, f"{published[name]:g} {unit}", f"{emps['coefficients'][name]:.4g} {unit}"]
            for name, (label, unit) in COEFFICIENTS.items()
        ],
    )
    yield table(
        ["record", "verdict", "reason"],
        [
            [name, record["verdict"], record["reason"].partition(". Not judged")[0]]
            for name, record in emps["records"].items()
        ],
    )


def _period(name: str, tests: Sequence[Figures]) -> list[str]:
    first, last = PERIODS[name]
    those = [test for test in tests if first <= test["date"] <= last]
    ratios = [f"{ratio:.2f}" for ratio in sorted(test["ratio"] for test in those)]
    ends = ratios[0] if len(ratios) == 1 else f"{ratios[0]} to {ratios[-1]}"
    levels = [level for level, _ in groupby(test["level"] for test in those)]
    lives = [test for test in those if test["life_days"]]
    life = ""
    if lives:
        quantiles = ", ".join(f"{days:.2g}" for days in lives[-1]["life_days"])
        life = f"{quantiles} (test of {lives[-1]['date']})"
    return [name, ends, ", then ".join(levels), life]


def rewritten(document: str, new: Sequence[Sequence[str]]) -> str:
    """Return the document with each table replaced by the new table with the same headings.

    Raises
    ------
    ValueError
        If the document does not have exactly one table with these headings.
    """
    lines = document.splitlines()
    for rows in new:
        places = [number for number, line in enumerate(lines) if line == rows[0]]
        if len(places) != 1:
            raise ValueError(f"{len(places)} tables begin with {rows[0]!r}: expected 1")
        (start,) = places
        rest = np.array([not line.startswith("|") for line in lines[start:]] + [True])
        lines[start : start + int(np.argmax(rest))] = rows
    return "\n".join(lines) + "\n"


@click.command(help=__doc__)
@click.argument("figures", type=click.Path(exists=True, path_type=Path))
@click.option("--write", "document", type=click.Path(exists=True, path_type=Path))
@click.option("--picture", type=click.Path(path_type=Path))
def main(figures: Path, document: Path | None, picture: Path | None) -> None:
    """Print the tables. Write them to the document and draw the picture if these are given."""
    values = json.loads(figures.read_text(encoding="utf-8"))
    new = list(tables(values))
    for rows in new:
        click.echo("\n".join(rows) + "\n")
    if document is not None:
        document.write_text(rewritten(document.read_text(encoding="utf-8"), new), encoding="utf-8")
    if picture is not None:
        draw(values, picture)


if __name__ == "__main__":
    main()
