"""How many changes of the rate of growth are told, how late, and how many that there were not.

    python benchmarks/regimes.py [--lives N] [--json FILE]

The tracker, no law known, follows lives by the laws for development (foreign_lives.py), by those
of the simulated lives (prognosis_lives.py, on seeds of their own), and of constant faults, every
other one under a wave. A change counts where the dominant fault has eight tests before and after
it; it is told when an event names an hour within 100 h. Any other event is a false one, whatever
fault it is of. A life of an avalanche has one change, its onset; one of missions has many.

Prints a table; writes JSON.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from foreign_laws import DEVELOPMENT, Avalanche, LostLubrication
from foreign_lives import ForeignCase, ForeignLife, constant_lives, lives_of
from numpy.typing import NDArray
from prognosis_estimates import drawn
from prognosis_lives import ScoredLife, next_units
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table
from trials import workers

from ema_core.faults import TYPICAL
from ema_monitor.prognosis.growth.regimes import REGIME
from ema_monitor.prognosis.growth.tracker import Tracker

BESIDE = 8
NEAR_HOURS = 100.0


@dataclass(frozen=True)
class Told:
    """What was told in a life.

    Attributes
    ----------
    kind
        What the life is by.
    tests, changes, found, false
        Numbers of its tests, of its changes, of those found, and of events beside these.
    delays
        Tests from each change found to its event.
    """

    kind: str
    tests: int
    changes: int
    found: int
    false: int
    delays: tuple[int, ...]


def changes_of(life: ForeignLife) -> NDArray[np.float64]:
    """Return the service hours at which the rate of the dominant fault changes [h]."""
    grown = life.grown[0]
    if isinstance(grown.law, LostLubrication):
        return np.array([grown.since + grown.law.at])
    if isinstance(grown.law, Avalanche):
        return np.array([grown.since + grown.law.onset])
    if not grown.states.size:
        return np.empty(0)
    return grown.hours[1:][np.diff(grown.states[:, 0]) != 0.0]


def told(case: ForeignCase | ScoredLife) -> Told:
    """Return what the tracker tells of a life."""
    changes, dominant, start = np.empty(0), "", 0.0
    if isinstance(case, ForeignCase):
        life = case.life()
        measurements = case.measurements(life)
        kind = case.kind or f"constant{', with a wave' if case.number % 2 else ''}"
        if life.grown:
            changes, dominant, start = changes_of(life), life.dominant, life.start_hours
    else:
        simulated = case.life()
        measurements, kind = drawn(case, simulated), f"simulated: {case.kind}"
    hours = np.array([one.hours for one in measurements if one.hours >= start])
    changes = np.array(
        [at for at in changes if min(np.sum(hours < at), np.sum(hours > at)) >= BESIDE]
    )
    tracker, open_changes, delays, false = Tracker(), list(changes), [], 0
    for measurement in measurements:
        for event in tracker.update(measurement):
            if event.kind != REGIME:
                continue
            at = min(open_changes, key=lambda at: abs(at - event.hours), default=np.inf)
            if event.component == dominant and abs(at - event.hours) <= NEAR_HOURS:
                open_changes.remove(at)
                delays.append(int(np.sum((hours > at) & (hours <= measurement.hours))))
            else:
                false += 1
    return Told(kind, len(measurements), changes.size, len(delays), false, tuple(delays))


@click.command()
@click.option("--lives", default=12, show_default=True, type=click.IntRange(1), help="of each kind")
@click.option("--json", "output", type=click.Path(path_type=Path), help="Where the figures go.")
def main(lives: int, output: Path | None) -> None:
    """Print how many changes are told."""
    cases = [
        *lives_of(DEVELOPMENT, lives),
        *next_units(lives * len(TYPICAL)),
        *constant_lives(2 * lives),
    ]
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with (
        Progress(*columns, console=Console(stderr=True)) as progress,
        workers(progress) as pool,
    ):
        found = pool.map("lives", told, cases)
    table = Table("lives", "number", "tests", "changes", "told", "tests until then", "told falsely")
    rows = []
    for kind in dict.fromkeys(one.kind for one in found):
        of_it = [one for one in found if one.kind == kind]
        delays = [delay for one in of_it for delay in one.delays]
        row = {
            "kind": kind,
            "lives": len(of_it),
            "tests": sum(one.tests for one in of_it),
            "changes": sum(one.changes for one in of_it),
            "found": sum(one.found for one in of_it),
            "median_delay": float(np.median(delays)) if delays else None,
            "false": sum(one.false for one in of_it),
        }
        rows.append(row)
        table.add_row(*("" if value is None else f"{value}" for value in row.values()))
    Console().print(table)
    if output is not None:
        output.write_text(json.dumps({"lives": lives, "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
