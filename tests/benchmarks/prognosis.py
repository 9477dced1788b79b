"""Accuracy and honesty of the remaining useful life over seeded lives to failure.

    python tests/benchmarks/prognosis.py [--lives N] [--constant N] [--real N] [--json FILE]

Lives have estimates drawn with the measured errors of the estimator (estimator_errors.jsonl); those
of --real are simulated and identified test by test. Their seeds are fixed, and nothing was tuned on
them. The tracker knows the laws and typical rates, or no law at all; a linear trend through the
latest estimates stands beside it, and an oracle to which only the noise of the future is unknown:
more than that nobody can predict. Prints tables and writes JSON.
"""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cases
import click
import numpy as np
from exactness import HEALTHY_WINDOWS, noisy_window
from prognosis_estimates import drawn
from prognosis_lives import SEED, ScoredLife, constant, estimate_of, growing, real
from prognosis_predictors import PREDICTORS
from prognosis_scores import LifeScore, by_kind
from prognosis_tables import rows, score_table
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from tables import target_table
from trials import ACTUATOR, Workers, workers

from ema_monitor.calibration import Calibration
from ema_monitor.healthy_fit import calibrate
from ema_monitor.prognosis.observation import Observation
from ema_sim.lives import Life

Scores = dict[str, LifeScore]


@dataclass(frozen=True, eq=False)
class InTheLoop:
    """A life to be simulated and identified test by test."""

    scored: ScoredLife
    calibration: Calibration


def score_drawn(scored: ScoredLife) -> Scores:
    """Score a life with drawn estimates."""
    life = scored.life()
    return _scores(scored, life, drawn(scored, life))


def score_real(job: InTheLoop) -> Scores:
    """Score a life with the simulator and the estimator in the loop."""
    life = job.scored.life()
    observations, last = [], None
    for test, (hours, window) in enumerate(zip(life.hours, life.windows, strict=True)):
        estimate = estimate_of(job.scored.case(life, test), window, job.calibration, last)
        if estimate is not None and estimate.valid:
            last = estimate.faults
            observations.append(Observation.of(estimate, float(hours)))
    return _scores(job.scored, life, observations)


def reports(scored: ScoredLife) -> dict[str, tuple[int, int]]:
    """Return after how many tests of a constant life something is predicted, of how many."""
    life = scored.life()
    observations = drawn(scored, life)
    return {
        name: (int(np.sum(np.isfinite(predict(life, observations).median))), len(observations))
        for name, predict in PREDICTORS.items()
    }


def _scores(scored: ScoredLife, life: Life, observations: Sequence[Observation]) -> Scores:
    return {
        name: LifeScore.of(scored.kind, scored.number, life.end_hours, predict(life, observations))
        for name, predict in PREDICTORS.items()
    }


def measure(pool: Workers, lives: int, constants: int, reals: int) -> dict[str, Any]:
    """Return all figures."""
    figures: dict[str, Any] = {"seed": SEED}
    scores = pool.map("lives, drawn estimates", score_drawn, growing(lives))
    figures["drawn"], figures["drawn_lives"] = _figures(scores)
    told = pool.map("constant lives", reports, constant(constants))
    figures["constant"] = {
        name: {
            "lives": constants,
            "reported": sum(life[name][0] > 0 for life in told),
            "tests_with_report": sum(life[name][0] for life in told),
            "tests": sum(life[name][1] for life in told),
        }
        for name in PREDICTORS
    }
    if reals:
        healthy = cases.healthy(HEALTHY_WINDOWS, "calibration")
        calibration = calibrate(pool.map("healthy windows", noisy_window, healthy), ACTUATOR)
        jobs = [InTheLoop(scored, calibration) for scored in real(reals)]
        scores = pool.map("lives in the loop", score_real, jobs)
        figures["real"], figures["real_lives"] = _figures(scores)
    return figures


def _figures(scores: Sequence[Scores]) -> tuple[dict[str, Any], dict[str, Any]]:
    of_each = {name: [life[name] for life in scores] for name in PREDICTORS}
    return (
        {name: by_kind(of_one) for name, of_one in of_each.items()},
        {name: [score.as_json() for score in of_one] for name, of_one in of_each.items()},
    )


def show(console: Console, figures: Mapping[str, Any]) -> None:
    """Print the tables."""
    console.print(score_table("lives to failure, drawn estimates", figures["drawn"]))
    if "real" in figures:
        console.print(score_table("simulator and estimator in the loop", figures["real"]))
    console.print(
        "CRA: mean of 1 - |r* - r| / r* over the tests in the second half of life, r the median of "
        "the remaining useful life and r* the truth; no prediction counts 0. On time of event: the "
        "same predictions by 1 - |r* - r| / EoL. a-l: lives in which at least half of the "
        "probability is within 20 % of r* at that share of the time from the first prediction to "
        "the end. covers: 90 % intervals that hold the truth, of all tests and of those in the "
        "second half. horizon, convergence, first prediction: medians.\n"
    )
    for name, one in figures["constant"].items():
        console.print(
            f"{one['lives']} lives of constant faults, {name}: {one['reported']} with a life "
            f"reported, after {one['tests_with_report']} of {one['tests']} tests"
        )
    console.print(target_table("prognosis", rows(figures)))


@click.command()
@click.option("--lives", default=300, show_default=True, type=click.IntRange(5))
@click.option("--constant", "constants", default=100, show_default=True, type=click.IntRange(1))
@click.option("--real", "reals", default=20, show_default=True, type=click.IntRange(0))
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(lives: int, constants: int, reals: int, output: Path | None) -> None:
    """Print the tables and write the JSON file."""
    started = time.perf_counter()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with (
        Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True)) as progress,
        workers(progress) as pool,
    ):
        figures = measure(pool, lives, constants, reals)
    figures["duration_s"] = time.perf_counter() - started
    console = Console(width=165)
    show(console, figures)
    console.print(f"{figures['duration_s']:.0f} s in all")
    if output:
        output.write_text(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
