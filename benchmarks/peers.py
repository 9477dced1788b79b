"""The identification beside optimizers that a user would pick instead, on the same objective.

    tools/peers.sh python benchmarks/peers.py [--cases N] [--json FILE]

Half of the cases are the thesis's single faults, half are drawn by its law; the sensors are noisy.
Every window of the model that a method evaluates is counted, those of its difference quotients
too, and its best point by cost is kept after every batch. Afterwards the true faults show when
that point first had an error of at most 5, 2 and 1 % of the range: no method knows, and none would
stop there. All of them know the healthy point except the random starts, and each population is one
batch, as ours is. Medians are over all cases; a case that did not get there counts as infinitely
late.

"Ours" is the whole identification as shipped, its putting back of insignificant components and its
covariance included; its swarm searches phase and eccentricity as they are, all others their plane.
The end is where a method stops by itself or the budget of 10,000 does.

Prints a table and writes JSON.
"""

import json
import math
import statistics
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cases
import click
import numpy as np
from cases import Case
from exactness import HEALTHY_WINDOWS, calibration_on, noisy_window
from numpy.typing import NDArray
from peer_methods import METHODS, Moment, Task
from rich import box
from rich.console import Console
from rich.progress import track
from rich.table import Table
from yardstick import seconds_per_window

from ema_core.faults import estimation_error

LEVELS_PERCENT: Final = (5.0, 2.0, 1.0)
BUDGET: Final = 10_000


@dataclass(frozen=True, eq=False)
class Run:
    """How the error of a method went in a case [%], over evaluations and time [s]."""

    evaluations: NDArray[np.int64]
    seconds: NDArray[np.float64]
    errors: NDArray[np.float64]

    @classmethod
    def of(cls, trace: list[Moment], case: Case) -> "Run":
        """Judge a trace by the true faults."""
        return cls(
            np.array([moment.evaluations for moment in trace]),
            np.array([moment.seconds for moment in trace]),
            np.array([estimation_error(moment.faults, case.faults) for moment in trace]),
        )

    def reached(self, level: float) -> tuple[float, float]:
        """Return evaluations and seconds until the error was first at most so large."""
        there = np.flatnonzero(self.errors <= level)
        if not len(there):
            return math.inf, math.inf
        return float(self.evaluations[there[0]]), float(self.seconds[there[0]])


def pick_cases(count: int) -> list[Case]:
    """Return the cases: half of them single faults, up to the ten that there are."""
    first = [some[0] for name, some in cases.thesis_faults(1).items() if name != "multiple"]
    singles = first[: count // 2]
    return singles + cases.by_the_law(count - len(singles))


def summary(runs: list[Run]) -> dict[str, Any]:
    """Return a method's medians over all cases; None where half of them never got there."""

    def median(values: list[float]) -> float | None:
        # Of an even number the upper one: no mean with infinity.
        middle = statistics.median_high(values)
        return middle if math.isfinite(middle) else None

    levels = {}
    for level in LEVELS_PERCENT:
        evaluations, seconds = map(list, zip(*(r.reached(level) for r in runs), strict=True))
        levels[f"{level:g}"] = {
            "evaluations": median(evaluations),
            "seconds": median(seconds),
            "share": statistics.fmean(map(math.isfinite, evaluations)),
        }
    return {
        "reached_percent": levels,
        "end": {
            "error_percent": statistics.median(float(run.errors[-1]) for run in runs),
            "evaluations": statistics.median(int(run.evaluations[-1]) for run in runs),
            "seconds": statistics.median(float(run.seconds[-1]) for run in runs),
        },
    }


def table_of(summaries: dict[str, dict[str, Any]], count: int) -> Table:
    """Return what is printed."""
    table = Table(
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        title=f"until the best point so far has an error of at most ..., {count} cases",
    )
    table.add_column("method", no_wrap=True)
    for level in LEVELS_PERCENT:
        table.add_column(f"{level:g} %\nevals", justify="right")
        table.add_column("\ns", justify="right")
        table.add_column("\nshare", justify="right")
    for head in ("end\nerror %", "\nevals", "\ns"):
        table.add_column(head, justify="right")

    def cell(value: float | None, form: str) -> str:
        return "-" if value is None else format(value, form)

    for name, figures in summaries.items():
        cells = []
        for reached in figures["reached_percent"].values():
            cells += [cell(reached["evaluations"], ".0f"), cell(reached["seconds"], ".3f")]
            cells.append(f"{reached['share']:.0%}")
        end = figures["end"]
        cells += [
            f"{end['error_percent']:.2f}",
            f"{end['evaluations']:.0f}",
            f"{end['seconds']:.2f}",
        ]
        table.add_row(name, *cells)
    return table


@click.command()
@click.option("--cases", "count", type=click.IntRange(2), default=20, show_default=True)
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(count: int, output: Path | None) -> None:
    """Print the table and write the JSON file."""
    console = Console(width=120)
    calibration = calibration_on(cases.healthy(HEALTHY_WINDOWS, "calibration"))
    runs: dict[str, list[Run]] = {name: [] for name in METHODS}
    units = []
    for number, case in enumerate(track(pick_cases(count), "cases", console=Console(stderr=True))):
        window = noisy_window(case)
        units.append(seconds_per_window())
        for name, method in METHODS.items():
            if number == 0:  # not timed: kernels and modules are loaded
                method(Task(window, calibration, number, 1000))
            trace = method(Task(window, calibration, number, BUDGET))
            runs[name].append(Run.of(trace, case))
    summaries = {name: summary(of_cases) for name, of_cases in runs.items()}
    unit = statistics.median(units)
    console.print(table_of(summaries, count))
    console.print(f"a window of the yardstick takes {1e6 * unit:.0f} us on one core")
    if output:
        results = {"cases": count, "yardstick_window_s": unit, "methods": summaries}
        output.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
