# SPDX-License-Identifier: Apache-2.0
"""``ema compare``: compare algorithms on one window of a bag."""

import json
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from ema_cli.bags.identifying import Identifying, as_object
from ema_cli.bags.reading import identifiable_windows
from ema_cli.comparison import AlgorithmComparison, choose_window, compare_algorithms
from ema_cli.options import REFUSED, NameChoice
from ema_cli.parameters import settings_options
from ema_core.faults import FAULTS
from ema_monitor.identification.estimate import by_fault
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.recordings.windows import BagWindows


class _Algorithms(click.ParamType):
    """Option type: comma-separated names of registered algorithms."""

    name = "names"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[str]:
        """Split the value at commas and return the names; refuse duplicates."""
        choice = NameChoice("algorithm", ALGORITHMS)
        names = [choice.convert(name, param, ctx) for name in value.split(",")]
        for name in names:
            if names.count(name) > 1:
                self.fail(f"{name} is specified more than once", param, ctx)
        return names


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@settings_options(Identifying)
@click.option(
    "--algorithms",
    default=",".join(ALGORITHMS),
    type=_Algorithms(),
    help="Algorithms, separated by commas.",
)
@click.option(
    "--window",
    "number",
    type=click.IntRange(0),
    help="Number of the window, from 0; by default the first usable window.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print one object with an estimate per algorithm."
)
def compare(
    bag: Path, options: Identifying, algorithms: list[str], number: int | None, as_json: bool
) -> None:
    """Compare algorithms on one window of BAG: faults, accuracy and computing time.

    Each algorithm starts from the healthy actuator with the same seed and budget. If the bag
    records the true faults, the error is the distance to them in percent of their ranges. The
    search fitness is the result of the algorithm alone; the estimate then drops insignificant
    faults and fits the rest again. With --json, each result includes the convergence: evaluations
    and lowest cost. Exit code 3: the estimate of an algorithm is not valid.
    """
    if options.any_motion:
        raise click.UsageError(
            "--any-motion: algorithms are compared on a test cycle, not on a stretch of ordinary "
            "motion; use `ema estimate --any-motion --algorithm NAME` for the combined stretches"
        )
    options = options.with_calibration_beside([bag])
    calibration = options.calibration_of_model()
    bag_windows = identifiable_windows(bag, options)
    chosen = choose_window(bag_windows, number)
    truth = bag_windows.true_faults(chosen.start_ns)
    comparison = compare_algorithms(chosen, algorithms, calibration, options, truth)
    start, end = bag_windows.seconds(chosen.start_ns), bag_windows.seconds(chosen.end_ns)
    title = f"window {chosen.number}, {start:.4f} s to {end:.4f} s"
    if as_json:
        click.echo(json.dumps(_as_object(comparison, bag_windows), indent=2))
    else:
        click.echo(f"calibration {calibration.calibration_id} ({options.calibration_source})")
        _print(comparison, title)
    if not all(run.estimate.valid for run in comparison.runs):
        sys.exit(REFUSED)


def _as_object(comparison: AlgorithmComparison, bag_windows: BagWindows) -> dict[str, Any]:
    truth = comparison.truth
    return {
        "window": comparison.recorded.number,
        "start": round(bag_windows.seconds(comparison.recorded.start_ns), 9),
        "end": round(bag_windows.seconds(comparison.recorded.end_ns), 9),
        "truth": None if truth is None else by_fault(truth),
        "fitness_at_truth": comparison.fitness_at_truth,
        "estimates": [
            as_object(run.estimate, bag_windows)
            | {
                "generations": len(run.costs),
                "course": [
                    [int(n), _number(cost)]
                    for n, cost in zip(run.evaluations, run.costs, strict=True)
                ],
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


def table_of_runs(comparison: AlgorithmComparison, title: str) -> Table:
    """Return a table with the cost, error and time of each algorithm."""
    runs = comparison.runs
    columns = {
        "algorithm": [run.estimate.algorithm for run in runs],
        "search\nfitness": [_figure(run.search_fitness, ".5f") for run in runs],
        "fitness\n[A^2.s]": [_figure(run.estimate.fitness, ".5f") for run in runs],
        "goodness\nof fit": [_figure(run.estimate.goodness_of_fit, ".2f") for run in runs],
        "valid": ["yes" if run.estimate.valid else "[red]no[/]" for run in runs],
        "eval-\nuations": [_figure(run.estimate.evaluations, "d") for run in runs],
        "gener-\nations": [str(len(run.costs)) for run in runs],
        "time\n[s]": [_figure(run.estimate.computing_time, ".2f") for run in runs],
    }
    if comparison.truth is not None:
        columns["error\n[%]"] = [_figure(comparison.error_percent(run), ".2f") for run in runs]
    return _table(title, columns, left=("algorithm", "valid"))


def table_of_faults(comparison: AlgorithmComparison) -> Table:
    """Return a table of the true and the estimated faults, and the sigma of the best estimate."""
    rows = {} if comparison.truth is None else {"truth": comparison.truth}
    rows |= {run.estimate.algorithm: run.estimate.faults for run in comparison.runs}
    title = "fault vectors"
    if comparison.best is not None:
        rows["sigma"] = comparison.best.estimate.sigma
        title += f", and sigma of {comparison.best.estimate.algorithm}"
    columns = {"": list(rows)}
    for i, fault in enumerate(FAULTS):
        heading = fault.label.replace(" ", "\n").replace("eccen", "eccen-\n")
        columns[heading] = [_figure(row[i], ".4f") for row in rows.values()]
    return _table(title, columns, left=("",))


def _table(title: str, columns: dict[str, list[str]], left: tuple[str, ...]) -> Table:
    """Return a table narrow enough for a terminal of 80 columns."""
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=0, show_edge=False)
    for heading in columns:
        justify = "left" if heading in left else "right"
        table.add_column(heading, justify=justify, vertical="bottom", no_wrap=heading in left)
    for row in zip(*columns.values(), strict=True):
        table.add_row(*row)
    return table


def _figure(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else "-"
