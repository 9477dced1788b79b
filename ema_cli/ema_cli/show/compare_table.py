"""Tables of a comparison of algorithms."""

from collections.abc import Callable

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from ema_cli.comparison import AlgorithmComparison, ComparedRun
from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, FAULTS


def table_of_runs(comparison: AlgorithmComparison, title: str) -> Table:
    """Return how each algorithm fared; the best valid one of each column has a star."""
    runs = comparison.runs
    columns = {
        "algorithm": [run.estimate.algorithm for run in runs],
        "search\nfitness": _starred(runs, lambda run: run.search_fitness, ".5f"),
        "fitness\n[A^2.s]": _starred(runs, lambda run: run.estimate.fitness, ".5f"),
        "goodness\nof fit": _starred(runs, lambda run: run.estimate.goodness_of_fit, ".2f"),
        "valid": ["yes" if run.estimate.valid else "[red]no[/]" for run in runs],
        "eval-\nuations": _starred(runs, lambda run: run.estimate.evaluations, "d"),
        "gener-\nations": [str(len(run.costs)) for run in runs],
        "time\n[s]": _starred(runs, lambda run: run.estimate.computing_time_s, ".2f"),
    }
    if comparison.truth is not None:
        columns["error\n[%]"] = _starred(runs, comparison.error_percent, ".2f")
    elif comparison.best is not None:
        columns["differs most\nfrom fittest in"] = [
            _largest_difference(run, comparison.best) for run in runs
        ]
    return _table(title, columns, left=("algorithm", "valid"))


def table_of_faults(comparison: AlgorithmComparison) -> Table:
    """Return the fault vectors below the true one, and the sigma of the fittest."""
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


def _starred(
    runs: list[ComparedRun], value_of: Callable[[ComparedRun], float], form: str
) -> list[str]:
    shown = {run: _figure(value_of(run), form) for run in runs}
    judged = {run: text for run, text in shown.items() if run.estimate.valid}
    if len(set(judged.values())) < 2:
        return list(shown.values())
    # What reads the same is equally good.
    best = shown[min(judged, key=value_of)]
    return [
        f"[bold green]{text}*[/]" if run in judged and text == best else f"{text} "
        for run, text in shown.items()
    ]


def _figure(value: float, form: str) -> str:
    return format(value, form) if np.isfinite(value) else "-"


def _largest_difference(run: ComparedRun, best: ComparedRun) -> str:
    faults, others = (np.array(one.estimate.faults) for one in (run, best))
    if run is best:
        return "fittest"
    if not np.all(np.isfinite(faults)):
        return "-"
    difference = faults - others
    # The phase counts by the eccentricity, wrapped to half a turn, as in the error of an estimate.
    turn = difference[ECCENTRICITY_PHASE]
    difference[ECCENTRICITY_PHASE] = faults[ECCENTRICITY] * (turn - np.round(turn))
    i = int(np.argmax(np.abs(difference)))
    return f"{FAULTS[i].label} {difference[i]:+.4f}"
