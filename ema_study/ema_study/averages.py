"""Means over runs, in the arrangements of the thesis's overviews."""

import pandas as pd

from ema_study.cases import LEVELS, SINGLE_FAULTS
from ema_study.plan import ALGORITHMS
from ema_study.printed_tables import MEAN, SIGMA, TOTAL
from ema_study.sources import counted


def single_fault_runs(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs of tables 11 to 54 that count."""
    runs = counted(runs)
    return runs[runs["fault"].isin(SINGLE_FAULTS)]


def overview_of(runs: pd.DataFrame, quantity: str) -> pd.DataFrame:
    """Return means over runs as tables 58 and 59 have them.

    Parameters
    ----------
    runs
        Runs of one source.
    quantity
        Column, e.g. "error_percent".

    Returns
    -------
    pandas.DataFrame
        As ``printed_tables.overview``. A mean over means is NaN where one of them is missing; the
        standard deviation is that of a sample.
    """
    means = single_fault_runs(runs).groupby(["algorithm", "level", "fault"])[quantity].mean()
    rows = pd.MultiIndex.from_product([ALGORITHMS, LEVELS], names=["algorithm", "level"])
    cells = means.unstack("fault").reindex(index=rows, columns=list(SINGLE_FAULTS))
    return with_margins(cells.astype(float))


def with_margins(cells: pd.DataFrame) -> pd.DataFrame:
    """Return an overview of its cells alone: with total, deviation and the row of means.

    Parameters
    ----------
    cells
        Means by algorithm and level (rows) and fault (columns).
    """
    table = cells.copy()
    table[TOTAL], table[SIGMA] = (
        table.mean(axis=1, skipna=False),
        table.std(axis=1, skipna=False),
    )
    last = table[list(SINGLE_FAULTS)].mean(skipna=False)
    table.loc[(MEAN, ""), :] = last
    return table.rename_axis(columns=None)


def fault_means_of(runs: pd.DataFrame, fault: str) -> pd.DataFrame:
    """Return the mean over the four algorithms' means of a fault, by level.

    Parameters
    ----------
    runs
        Runs of one source.
    fault
        One of ``SINGLE_FAULTS``.

    Returns
    -------
    pandas.DataFrame
        Index level; columns "time_s" [s] and "error_percent" [%]; NaN where an algorithm is
        missing.
    """
    columns = {}
    for quantity in ("time_s", "error_percent"):
        means = overview_of(runs, quantity)[fault]
        columns[quantity] = {
            level: means.xs(level, level="level").mean(skipna=False) for level in LEVELS
        }
    return pd.DataFrame(columns).rename_axis("level")
