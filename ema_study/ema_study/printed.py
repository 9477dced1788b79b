# SPDX-License-Identifier: Apache-2.0
"""Printed results of the thesis: its 500 runs of tables 9 to 57, and its other tables."""

from functools import cache
from importlib.resources import files
from typing import Final

import pandas as pd

from ema_study.cases import SINGLE_FAULTS
from ema_study.stop_rules import uncounted_populations

POPULATION: Final = 50
GENERATIONS: Final = 200
"""Settings of the thesis's algorithms: population and largest number of generations."""

PRINTED: Final = "printed"
"""Value in place of a model's name for results printed in the thesis."""

TOTAL: Final = "total"
SIGMA: Final = "standard deviation"
MEAN: Final = "mean"
SUM: Final = "sum"

TRIALS: Final = 8
"""Table of the trials of GA."""

SPEED_STUDY: Final = 56
PRECISION_STUDY: Final = 57
"""Tables of the two studies of the multiple fault."""

OVERVIEWS: Final[dict[int, str]] = {58: "error_percent", 59: "time_s"}
"""Column of the runs that each overview table summarises, keyed by table number."""

SINGLE_RELIABILITY: Final = 60
MULTIPLE_RELIABILITY: Final = 61
"""Tables of the reliability coefficients for the single faults and the multiple fault."""

SUMMARIES: Final[dict[int, str]] = dict(zip((19, 28, 37, 46, 55), SINGLE_FAULTS, strict=True))
"""Fault of each summary table, keyed by table number."""


def printed_runs() -> pd.DataFrame:
    """Return the runs printed in the thesis as a table with one row per run.

    The columns are the columns of ``ema_study.run.as_frame`` that the thesis prints, with ``model``
    "printed", and ``note``. ``evaluations`` are computed from the generations: populations of 50,
    including the starting population, which only GWO counts as a generation.

    Notes
    -----
    The true backlash is 0.747 as printed; its errors follow from 0.7474 (docs/errata.md).
    """
    with (files("ema_study") / "thesis_runs.csv").open(encoding="utf-8") as file:
        runs = pd.read_csv(file)
    uncounted = runs["algorithm"].map(uncounted_populations)
    return runs.assign(
        note=runs["note"].fillna(""),
        model=PRINTED,
        population=POPULATION,
        max_generations=GENERATIONS,
        evaluations=POPULATION * (runs["generations"] + uncounted),
    )


@cache
def printed_table(name: str) -> pd.DataFrame:
    """Return a table that the thesis prints in addition to its runs; missing values are NaN.

    The result is cached: do not change it.

    Parameters
    ----------
    name
        One of the following, with times in s and errors in percent:

        - "trials": table 8, one row per trial; "at_least" marks times that are lower bounds
        - "run_means": the means over runs, one row per table and algorithm
        - "fault_means": tables 19, 28, 37, 46 and 55, one row per table and level
        - "table_58", "table_59": mean errors and times, one row per algorithm and level, and a last
          row ("mean", ""); columns are the faults, "total" and "standard deviation"
        - "table_60": one row per algorithm, and "sum"; columns (fault, "time x error" or "RC")
        - "table_61": one row per algorithm, and "sum"
    """
    with (files("ema_study") / "printed_tables" / f"{name}.csv").open(encoding="utf-8") as file:
        return pd.read_csv(
            file,
            index_col=[0] if name in ("trials", "table_60", "table_61") else [0, 1],
            header=[0, 1] if name == "table_60" else [0],
            keep_default_na=False,
            na_values=["-"],
        )
