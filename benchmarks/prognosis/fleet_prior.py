# SPDX-License-Identifier: Apache-2.0
"""Gain of a unit's prognosis from the growth of other units, and loss from an unsuitable fleet.

    python -m prognosis.fleet_prior [--fleet N] [--lives N] [--json FILE]

The tracker does not know the growth law. Lives with drawn estimates are scored without a fleet,
with a fleet of N earlier units of the same kind that ran to failure, and with a fleet of N units
whose faults grow by other laws. Each life is compared with the same life without a fleet; the gain
has a standard error over the lives.

Prints a table and writes JSON.
"""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from rich.table import Table
from script import Figures, Workers, command
from targets import grid

from ema_core.faults import TYPICAL
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.fleet_growth import FleetGrowth, UnitGrowth
from ema_monitor.prognosis.growth.fleet_prior import grid_digest
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import FleetPrior, TrackerSettings
from prognosis.estimates import drawn
from prognosis.lives import ScoredLife, lives_of
from prognosis.predictors import tracked
from prognosis.scores import LifeScore, summary

WITHOUT, SAME, OTHER = "no fleet", "fleet", "fleet of another kind"


def unit_of(scored: ScoredLife) -> UnitGrowth:
    """Return the growth of the faults in a life, as evidence for a fleet."""
    measurements = drawn(scored, scored.life())
    tracker = Tracker(HealthLimits(), TrackerSettings())
    for measurement in measurements:
        tracker.update(measurement)
    return UnitGrowth(len(measurements), tuple(tracker.grown_faults().values()))


def scores_of(priors: dict[str, FleetPrior | None], scored: ScoredLife) -> dict[str, LifeScore]:
    """Return the scores of a life by name of the prior."""
    life = scored.life()
    measurements = drawn(scored, life)
    made = {
        name: tracked(measurements, TrackerSettings(fleet=prior)) for name, prior in priors.items()
    }
    return {name: LifeScore.of(scored.kind, life.end_hours, entry) for name, entry in made.items()}


def measure(pool: Workers, fleet: int, lives: int) -> Figures:
    """Compare the prognosis of lives without, with a suitable, and with an unsuitable fleet."""
    limits = HealthLimits()
    priors: dict[str, FleetPrior | None] = {WITHOUT: None}
    for name, stream in ((SAME, "fleet"), (OTHER, "fleet_otherwise")):
        units = pool.map(name, unit_of, lives_of(stream, fleet))
        by_number = {str(number): unit for number, unit in enumerate(units)}
        priors[name] = FleetGrowth(grid_digest(limits), by_number).prior(limits)
    scores = pool.map("lives", partial(scores_of, priors), lives_of("next", lives))
    figures = [row for kind in (*TYPICAL, "all") for row in _rows(kind, scores)]
    return {"units": fleet, "lives": lives, "rows": figures}


def _rows(kind: str, scores: Sequence[dict[str, LifeScore]]) -> list[Figures]:
    """Return the scores of a kind of dominant fault, or of "all", with each prior."""
    chosen = [score for score in scores if kind in (score[WITHOUT].kind, "all")]
    rows = []
    for name in (WITHOUT, SAME, OTHER) if chosen else ():
        figures = summary([score[name] for score in chosen])
        gain = np.array([score[name].cra - score[WITHOUT].cra for score in chosen])
        # A single life has no standard error.
        error = gain.std(ddof=1) / np.sqrt(len(gain)) if len(gain) > 1 else np.nan
        rows.append(
            {
                "fault": kind,
                "prior": name,
                "lives": len(chosen),
                "accuracy": figures["cra"],
                "gain": float(gain.mean()),
                "its_standard_error": float(error),
                "alpha_lambda": figures["alpha_lambda_0.75"],
                "coverage": figures["coverage"],
            }
        )
    return rows


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print."""
    every = figures["rows"]
    yield grid(
        f"law unknown, fleets of {figures['units']}, {figures['lives']} lives",
        (name.replace("_", " ") for name in every[0]),
        (entry.values() for entry in every),
        digits=3,
    )


main = command(measure, "fleet prior", tables=tables, fleet=30, lives=150)

if __name__ == "__main__":
    main()
