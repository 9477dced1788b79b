"""``ema compare``: every algorithm on one window of a bag."""

import json
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from ema_bags.windows import BagWindows
from ema_cli.bags.identifying import Identifying, as_object
from ema_cli.bags.source import identifiable_windows
from ema_cli.comparison import AlgorithmComparison, choose_window, compare_algorithms
from ema_cli.errors import REFUSED, NameChoice, one_clear_line
from ema_cli.figures.comparison import draw_comparison
from ema_cli.figures.files import picture_option, require_drawable, save_picture
from ema_cli.parameters import settings_options
from ema_cli.show.compare_table import table_of_faults, table_of_runs
from ema_monitor.identification.estimate import by_fault
from ema_monitor.optimizers import ALGORITHMS


class _Algorithms(click.ParamType):
    """Registered names with commas between."""

    name = "names"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[str]:
        """Return the names in the order given, each once."""
        choice = NameChoice("algorithm", ALGORITHMS)
        names = [choice.convert(name, param, ctx) for name in value.split(",")]
        for name in names:
            if names.count(name) > 1:
                self.fail(f"{name} is given more than once", param, ctx)
        return names


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@settings_options(Identifying)
@click.option(
    "--algorithms",
    default=",".join(ALGORITHMS),
    type=_Algorithms(),
    help="Which to compare, with commas between.",
)
@click.option(
    "--window",
    "number",
    type=click.IntRange(0),
    help="Which window, from 0; by default the first that can be used.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one object, an estimate an algorithm.")
@picture_option("; by default BAG-compare.png")
def compare(
    bag: Path,
    given: Identifying,
    algorithms: list[str],
    number: int | None,
    as_json: bool,
    output: Path | None,
) -> None:
    """Compare algorithms on one window of BAG: what each finds, how well, and how fast.

    Each begins at the healthy actuator with the same seed and budget. Where the bag records the
    true faults, the error is the distance to them in percent of their ranges. The search fitness
    is where the algorithm itself ended; the estimate then drops what is not significant and fits
    the rest once more.
    """
    with one_clear_line():
        if given.any_motion:
            raise ValueError(
                "--any-motion: algorithms are compared on one test cycle, and a stretch of "
                "ordinary motion is none; `ema estimate --any-motion --algorithm NAME` shows what "
                "one makes of the stretches combined"
            )
        picture = output or _beside(bag)
        require_drawable(picture)
        calibration = given.calibration_of_model()
        found = identifiable_windows(bag, given)
        chosen = choose_window(found, number)
        truth = found.true_faults(chosen.start_ns)
        comparison = compare_algorithms(chosen, algorithms, calibration, given, truth)
    start, end = found.seconds(chosen.start_ns), found.seconds(chosen.end_ns)
    title = f"window {chosen.number}, {start:.4f} s to {end:.4f} s"
    if as_json:
        click.echo(json.dumps(_as_object(comparison, found), indent=2))
    else:
        click.echo(f"calibration {calibration.calibration_id} ({given.calibration_source})")
        _print(comparison, title)
    if comparison.best is not None:
        unit = found.description
        with one_clear_line():
            name = f"{unit.actuator_id} ({unit.serial_number}), {title}"
            save_picture(draw_comparison(comparison, name), picture, dpi=150)
        click.echo(f"{picture}", err=as_json)
    if not all(run.estimate.valid for run in comparison.runs):
        sys.exit(REFUSED)


def _beside(bag: Path) -> Path:
    named = bag if bag.stem.strip(".") else bag.resolve()
    return named.with_name(f"{named.stem}-compare.png")


def _as_object(comparison: AlgorithmComparison, found: BagWindows) -> dict[str, Any]:
    truth = comparison.truth
    return {
        "window": comparison.found.number,
        "start": round(found.seconds(comparison.found.start_ns), 9),
        "end": round(found.seconds(comparison.found.end_ns), 9),
        "truth": None if truth is None else by_fault(truth),
        "fitness_at_truth": comparison.fitness_at_truth,
        "estimates": [
            as_object(run.estimate, found)
            | {
                "generations": len(run.costs),
                "search_fitness": _number(run.search_fitness),
                "error_percent": _number(comparison.error_percent(run)),
            }
            for run in comparison.runs
        ],
    }


def _number(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _print(comparison: AlgorithmComparison, title: str) -> None:
    if comparison.best is None:
        click.echo(title)
    else:
        console = Console()
        console.print(table_of_runs(comparison, title))
        console.print(table_of_faults(comparison))
        if comparison.fitness_at_truth is not None:
            click.echo(f"fitness at the true faults {comparison.fitness_at_truth:.5f} A^2.s")
    reasons: dict[str, list[str]] = {}
    for run in comparison.runs:
        if run.estimate.reason:
            valid = "" if run.estimate.valid else "no valid estimate: "
            reasons.setdefault(valid + run.estimate.reason, []).append(run.estimate.algorithm)
    for reason, names in reasons.items():
        click.echo(f"{', '.join(names)}: {reason}")
