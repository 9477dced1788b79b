"""How much the prognosis of a unit gains by the growth of others, and that it does not lose.

    python -m prognosis.fleet_prior [--fleet N] [--lives N] [--json FILE]

The law is not known. Lives by drawn estimates, as of prognosis.py, on seeds of their own, are
scored without a fleet, with that of N earlier units of the same kind, which lived to their ends,
and with one of N units whose faults grow by other laws. The difference of a life to the same life
without a fleet has a standard error over the lives.

Prints a table; writes JSON.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from trials import command, workers

from ema_core.faults import TYPICAL
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.fleet import Fleet, FleetUnit
from ema_monitor.prognosis.growth.fleet import grid_digest
from ema_monitor.prognosis.growth.settings import FleetPrior, TrackerSettings
from ema_monitor.prognosis.growth.tracker import Tracker
from prognosis.estimates import drawn
from prognosis.lives import ScoredLife, lives_of
from prognosis.predictors import tracked
from prognosis.scores import LifeScore, summary

WITHOUT, SAME, OTHER = "no fleet", "fleet", "fleet of another kind"


def unit_of(scored: ScoredLife) -> FleetUnit:
    """Return what a life says of growth."""
    measurements = drawn(scored, scored.life())
    tracker = Tracker(HealthLimits(), TrackerSettings())
    for measurement in measurements:
        tracker.update(measurement)
    return FleetUnit(len(measurements), tuple(tracker.grown_faults().values()))


def scores_of(priors: dict[str, FleetPrior | None], scored: ScoredLife) -> dict[str, LifeScore]:
    """Return the scores of a life with each prior."""
    life = scored.life()
    measurements = drawn(scored, life)
    return {
        name: LifeScore.of(
            scored.kind,
            scored.number,
            life.end_hours,
            tracked(measurements, TrackerSettings(fleet=prior)),
        )
        for name, prior in priors.items()
    }


def measure(progress: Progress, fleet: int, lives: int) -> dict[str, Any]:
    """Compare the prognosis of lives without a fleet, with that of N units, and with another."""
    limits = HealthLimits()
    known: dict[str, FleetPrior | None] = {WITHOUT: None}
    with workers(progress) as pool:
        for name, stream in ((SAME, "fleet"), (OTHER, "fleet_otherwise")):
            units = pool.map(name, unit_of, lives_of(stream, fleet))
            said = {str(number): unit for number, unit in enumerate(units)}
            known[name] = Fleet(grid_digest(limits), said).prior(limits)
        found = pool.map("lives", partial(scores_of, known), lives_of("next", lives))
    rows = [row for kind in (*TYPICAL, "all") for row in _rows(kind, found)]
    return {"units": fleet, "lives": lives, "rows": rows}


def _rows(kind: str, found: Sequence[dict[str, LifeScore]]) -> list[dict[str, Any]]:
    """Return the figures of a kind of dominant fault, or of all, with each prior."""
    chosen = [one for one in found if kind in (one[WITHOUT].kind, "all")]
    rows = []
    for name in (WITHOUT, SAME, OTHER) if chosen else ():
        figures = summary([one[name] for one in chosen])
        gain = np.array([one[name].cra - one[WITHOUT].cra for one in chosen])
        rows.append(
            {
                "fault": kind,
                "prior": name,
                "lives": len(chosen),
                "accuracy": figures["cra"],
                "gain": float(gain.mean()),
                "its_standard_error": float(gain.std(ddof=1) / np.sqrt(len(gain))),
                "alpha_lambda": figures["alpha_lambda"]["0.75"],
                "coverage": figures["coverage"],
            }
        )
    return rows


def show(console: Console, figures: Mapping[str, Any]) -> None:
    """Print the table."""
    title = f"law unknown, fleets of {figures['units']}, {figures['lives']} lives"
    table = Table(*(name.replace("_", " ") for name in figures["rows"][0]), title=title)
    for row in figures["rows"]:
        table.add_row(
            *(f"{value:.3f}" if isinstance(value, float) else str(value) for value in row.values())
        )
    console.print(table)


main = command(measure, show, fleet=30, lives=150)

if __name__ == "__main__":
    main()
