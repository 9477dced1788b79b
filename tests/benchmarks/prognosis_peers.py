"""The tracker beside NASA's progpy, on the same lives and the same drawn estimates.

    tools/peers.sh python tests/benchmarks/prognosis_peers.py [--lives N] [--json FILE]

Both predict after every test, in the same process. progpy looks at the dominant component alone,
whose name, side and law it is told; the tracker looks at all seven. Prints a table by our metrics,
and the cumulative relative accuracy that progpy itself computes of the same predictions: that is on
the time of the event, and so near 1 that it hardly tells good from bad.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np
from prognosis_estimates import drawn
from prognosis_lives import SEED, ScoredLife, growing
from prognosis_predictors import Predictions, law_known, law_unknown, linear_trend
from prognosis_progpy import PARTICLES, SAMPLES, particle_filter
from prognosis_scores import LifeScore, by_kind
from prognosis_tables import score_table
from progpy.predictors import ToEPredictionProfile  # pyright: ignore[reportMissingImports]
from progpy.uncertain_data import UnweightedSamples  # pyright: ignore[reportMissingImports]
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from trials import workers

_PEER = "progpy"
_LONGEST_HOURS = 4000.0


def compare(scored: ScoredLife) -> dict[str, tuple[LifeScore, float]]:
    """Return the scores of each method in a life, and progpy's own accuracy of it."""
    life = scored.life()
    observations = drawn(scored, life)
    made = {
        _PEER: particle_filter(life, observations),
        "law known": law_known(life, observations),
        "law unknown": law_unknown(life, observations),
        "linear trend": linear_trend(life, observations),
    }
    return {
        name: (
            LifeScore.of(scored.kind, scored.number, life.end_hours, one),
            accuracy_by_progpy(one, life.end_hours),
        )
        for name, one in made.items()
    }


def accuracy_by_progpy(made: Predictions, end_hours: float) -> float:
    """Return progpy's cumulative relative accuracy over the second half of life."""
    profile = ToEPredictionProfile()
    for hours, samples in zip(made.hours, made.samples, strict=True):
        if hours >= 0.5 * end_hours and np.all(~np.isnan(samples)):
            ends = hours + np.minimum(samples, _LONGEST_HOURS)
            profile.add_prediction(
                float(hours), UnweightedSamples([{"limit": float(end)} for end in ends])
            )
    if not profile:
        return 0.0
    return float(profile.cumulative_relative_accuracy({"limit": end_hours})["limit"])


def show(console: Console, figures: Mapping[str, Any]) -> None:
    """Print the table."""
    console.print(score_table("beside progpy, drawn estimates", figures["methods"]))
    console.print(
        f"progpy: {PARTICLES} particles, {SAMPLES} samples a prediction. Over the second half of "
        "life, cumulative relative accuracy of the remaining life, and by progpy's own function:"
    )
    for name, by_fault in figures["methods"].items():
        console.print(
            f"  {name:14} {by_fault['all']['cra']:6.3f}   {figures['by_progpy'][name]:6.3f}"
        )


@click.command()
@click.option("--lives", default=10, show_default=True, type=click.IntRange(5))
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(lives: int, output: Path | None) -> None:
    """Print the table and write the JSON file."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with (
        Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True)) as progress,
        workers(progress) as pool,
    ):
        compared = pool.map("lives", compare, growing(lives))
    of_each = {name: [life[name] for life in compared] for name in compared[0]}
    figures = {
        "seed": SEED,
        "methods": {name: by_kind([score for score, _ in told]) for name, told in of_each.items()},
        "by_progpy": {
            name: float(np.mean([value for _, value in told])) for name, told in of_each.items()
        },
        "lives": {name: [score.as_json() for score, _ in told] for name, told in of_each.items()},
    }
    show(Console(width=165), figures)
    if output:
        output.write_text(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
