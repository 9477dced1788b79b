"""The tables of means: 19, 28, 37, 46, 55 by fault, 58 and 59 of all single faults."""

import pandas as pd

from ema_study.averages import fault_means_of, overview_of, single_fault_runs
from ema_study.printed_runs import PRINTED
from ema_study.printed_tables import OVERVIEWS, SIGMA, SUMMARIES, TOTAL, fault_means, overview
from ema_study.sources import PRINTED_RUNS
from ema_study.tables.study_table import StudyTable
from ema_study.tables.threshold_notes import threshold_summary

_MEANS = {"time_s": "mean time [s]", "error_percent": "mean error [%]"}


def fault_summary(number: int, sources: dict[str, pd.DataFrame]) -> StudyTable:
    """Return the means of a fault over all four algorithms, by level.

    Parameters
    ----------
    number
        Of the thesis's table, one of ``SUMMARIES``.
    sources
        Runs by source.
    """
    fault = SUMMARIES[number]
    blocks = {PRINTED: fault_means().loc[[number]].droplevel("table").rename(columns=_MEANS)}
    for label, runs in computed(sources).items():
        blocks[label] = fault_means_of(runs, fault).rename(columns=_MEANS)
    title = f"{fault.replace('_', ' ').capitalize()}, mean over the algorithms"
    notes = [run_counts(sources, [fault]), *threshold_summary(sources, fault)]
    return StudyTable(number, title, side_by_side(blocks), notes)


def overview_table(number: int, sources: dict[str, pd.DataFrame]) -> StudyTable:
    """Return mean errors or times by algorithm, level and fault.

    Parameters
    ----------
    number
        58 for the errors, 59 for the times.
    sources
        Runs by source.
    """
    quantity = OVERVIEWS[number]
    blocks = {PRINTED: overview(number)}
    for label, runs in computed(sources).items():
        blocks[label] = overview_of(runs, quantity)
    blocks = {
        label: block.rename(columns=lambda name: name.replace("_", " "))
        for label, block in blocks.items()
    }
    what = {"error_percent": "Mean error [%]", "time_s": "Mean time [s]"}[quantity]
    notes = [
        f"{TOTAL.capitalize()} and {SIGMA} are those of the five means to the left.",
        run_counts(sources),
        *threshold_summary(sources),
    ]
    title = f"{what} by algorithm, level and fault"
    return StudyTable(number, title, side_by_side(blocks), notes)


def computed(sources: dict[str, pd.DataFrame]) -> dict[str, pd.DataFrame]:
    """Return the sources under the labels of what is computed from runs."""
    return {PRINTED_RUNS if label == PRINTED else label: sources[label] for label in sources}


def side_by_side(blocks: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Return one table of those of several sources; the first one gives the rows."""
    first = next(iter(blocks.values()))
    return pd.concat(blocks, axis=1, names=["source", "quantity"]).reindex(first.index)


def run_counts(sources: dict[str, pd.DataFrame], faults: list[str] | None = None) -> str:
    """Return a note on how many single-fault runs of each source there are."""
    counts = []
    for label, runs in sources.items():
        runs = single_fault_runs(runs)
        if faults is not None:
            runs = runs[runs["fault"].isin(faults)]
        counts.append(f"{label} {len(runs)}")
    return f"Number of runs: {'; '.join(counts)}. A mean over means is empty where one is missing."
