"""Means over runs as in the thesis's overviews, and its reliability coefficient of them.

``runs`` are those of one source.
"""

from typing import Final

import pandas as pd

from ema_study.cases import LEVELS, SINGLE_FAULTS
from ema_study.plan import ALGORITHMS
from ema_study.printed import MEAN, SIGMA, SUM, TOTAL
from ema_study.sources import single_fault_runs

SPEED_STUDY: Final = 56
PRECISION_STUDY: Final = 57
"""Tables of the two studies of the multiple fault."""


def overview_of(runs: pd.DataFrame, quantity: str) -> pd.DataFrame:
    """Return means over runs of a column, e.g. "error_percent", as ``printed.overview``.

    A mean over means is NaN where one of them is missing; the standard deviation is that of a
    sample.
    """
    means = single_fault_runs(runs).groupby(["algorithm", "level", "fault"])[quantity].mean()
    rows = pd.MultiIndex.from_product([ALGORITHMS, LEVELS], names=["algorithm", "level"])
    cells = means.unstack("fault").reindex(index=rows, columns=list(SINGLE_FAULTS)).astype(float)
    table = cells.assign(
        **{TOTAL: cells.mean(axis=1, skipna=False), SIGMA: cells.std(axis=1, skipna=False)}
    )
    table.loc[(MEAN, ""), :] = cells.mean(skipna=False)
    return table.rename_axis(columns=None)


def fault_means_of(runs: pd.DataFrame, fault: str) -> pd.DataFrame:
    """Return the mean over the four algorithms' means of a fault: time [s] and error [%] by level.

    NaN where an algorithm is missing.
    """
    columns = {}
    for quantity in ("time_s", "error_percent"):
        means = overview_of(runs, quantity)[fault].drop(index=(MEAN, ""))
        columns[quantity] = means.unstack("level")[list(LEVELS)].mean(skipna=False)
    return pd.DataFrame(columns)


def reliability_coefficients(products: pd.Series) -> pd.Series:
    """Return ``100 (1 - p_i / sum p)`` of products of time and error [%].

    Parameters
    ----------
    products
        Mean time times mean error by algorithm [s.%]. The coefficient compares algorithms, so it
        is NaN for all of them where one is missing.

    Notes
    -----
    Section 7.3; the equation carries the number 7.1 a second time. The coefficients of n algorithms
    add up to (n - 1) times 100 %.
    """
    return 100.0 * (1.0 - products / products.sum(skipna=False))


def with_coefficients(times: pd.Series, errors: pd.Series) -> pd.DataFrame:
    """Return mean times [s] and errors [%] by algorithm, products and coefficients, and the sum."""
    products = times * errors
    columns = {
        "time_s": times,
        "error_percent": errors,
        "time x error": products,
        "RC": reliability_coefficients(products),
    }
    table = pd.DataFrame(columns)
    table.loc[SUM, "time x error"] = products.sum(skipna=False)
    return table.rename_axis("algorithm")


def reliability_of_overviews(times: pd.DataFrame, errors: pd.DataFrame) -> pd.DataFrame:
    """Return table 60 from tables 59 [s] and 58 [%], as ``printed.reliability_single``.

    Time and error are means over both levels, as in the thesis.
    """
    mean_times, mean_errors = (
        table.groupby(level="algorithm").sum(min_count=len(LEVELS)).loc[list(ALGORITHMS)]
        / len(LEVELS)
        for table in (times, errors)
    )
    blocks = {
        fault: with_coefficients(mean_times[fault], mean_errors[fault])[["time x error", "RC"]]
        for fault in (*SINGLE_FAULTS, TOTAL)
    }
    return pd.concat(blocks, axis=1)


def multiple_fault_reliability(runs: pd.DataFrame, times_of: int, errors_of: int) -> pd.DataFrame:
    """Return table 61 with times and errors of given tables.

    The thesis uses the times of the study of speed (56) and the errors of the study of precision
    (57), which no run had together.
    """

    def means(table: int, quantity: str) -> pd.Series:
        of_table = runs[runs["table"] == table]
        return of_table.groupby("algorithm")[quantity].mean().reindex(list(ALGORITHMS))

    return with_coefficients(means(times_of, "time_s"), means(errors_of, "error_percent"))
