"""The thesis's reliability coefficient of an algorithm: tables 60 and 61."""

from typing import Final

import pandas as pd

from ema_study.averages import overview_of
from ema_study.cases import LEVELS, SINGLE_FAULTS
from ema_study.plan import ALGORITHMS
from ema_study.printed_tables import SUM, TOTAL

SPEED_STUDY: Final = 56
PRECISION_STUDY: Final = 57


def reliability_coefficients(products: pd.Series) -> pd.Series:
    """Return ``100 (1 - p_i / sum p)`` of products of time and error [%].

    Parameters
    ----------
    products
        Mean time times mean error by algorithm [s.%]. The coefficient compares algorithms, so it
        is NaN for all of them where one is missing.

    Notes
    -----
    Section 7.3; the equation carries the number 7.1 a second time. n algorithms share n - 1 times
    100 %.
    """
    return 100.0 * (1.0 - products / products.sum(skipna=False))


def with_coefficients(times: pd.Series, errors: pd.Series) -> pd.DataFrame:
    """Return times [s], errors [%], their product [s.%] and coefficient [%], and a row of the sum.

    Parameters
    ----------
    times, errors
        Means by algorithm.
    """
    products = times * errors
    table = pd.DataFrame(
        {
            "time_s": times,
            "error_percent": errors,
            "time x error": products,
            "RC": reliability_coefficients(products),
        }
    )
    table.loc[SUM] = [float("nan"), float("nan"), products.sum(skipna=False), float("nan")]
    return table.rename_axis("algorithm")


def single_fault_reliability(runs: pd.DataFrame) -> pd.DataFrame:
    """Return table 60 of the runs of one source, as ``printed_tables.reliability_single``."""
    return reliability_of_overviews(overview_of(runs, "time_s"), overview_of(runs, "error_percent"))


def reliability_of_overviews(times: pd.DataFrame, errors: pd.DataFrame) -> pd.DataFrame:
    """Return table 60 of tables 59 [s] and 58 [%].

    Time and error are means over both levels, as the thesis took them.

    Returns
    -------
    pandas.DataFrame
        As ``printed_tables.reliability_single``.
    """
    mean_times, mean_errors = (_over_levels(table) for table in (times, errors))
    algorithms = list(ALGORITHMS)
    blocks = {
        fault: with_coefficients(
            mean_times.loc[algorithms, fault], mean_errors.loc[algorithms, fault]
        )[["time x error", "RC"]]
        for fault in (*SINGLE_FAULTS, TOTAL)
    }
    return pd.concat(blocks, axis=1)


def _over_levels(table: pd.DataFrame) -> pd.DataFrame:
    return table.groupby(level="algorithm").sum(min_count=len(LEVELS)) / len(LEVELS)


def multiple_fault_reliability(runs: pd.DataFrame, times_of: int, errors_of: int) -> pd.DataFrame:
    """Return table 61 of the runs of one source.

    Parameters
    ----------
    runs
        Runs of one source.
    times_of, errors_of
        Table whose times, and whose errors, are taken. The thesis took the times of the study of
        speed (56) and the errors of the study of precision (57), which no run had together.

    Returns
    -------
    pandas.DataFrame
        As ``printed_tables.reliability_multiple``.
    """

    def means(table: int, quantity: str) -> pd.Series:
        of_table = runs[runs["table"] == table]
        return of_table.groupby("algorithm")[quantity].mean().reindex(list(ALGORITHMS))

    return with_coefficients(means(times_of, "time_s"), means(errors_of, "error_percent"))
