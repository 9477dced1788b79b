"""Figures that the thesis prints about its runs: tables 8, 19 to 61, means beside runs."""

from functools import cache
from importlib.resources import files
from typing import Any, Final

import pandas as pd
import yaml

from ema_study.cases import LEVELS, SINGLE_FAULTS
from ema_study.plan import ALGORITHMS

TOTAL: Final = "total"
SIGMA: Final = "standard deviation"
MEAN: Final = "mean"
SUM: Final = "sum"

OVERVIEWS: Final[dict[int, str]] = {58: "error_percent", 59: "time_s"}
"""Column of the overviews by algorithm, level and fault, by table."""

SUMMARIES: Final[dict[int, str]] = dict(zip((19, 28, 37, 46, 55), SINGLE_FAULTS, strict=True))
"""Faults of the summary tables, by table."""


@cache
def _printed() -> dict[str, Any]:
    text = (files("ema_study") / "printed_tables.yaml").read_text(encoding="utf-8")
    return yaml.safe_load(text)


def ga_trials() -> pd.DataFrame:
    """Return table 8 by number of the trial: generations, time [s], settings."""
    trials = _printed()["ga_trials"]
    return pd.DataFrame(trials["rows"], columns=trials["columns"]).set_index("trial")


def run_means() -> pd.DataFrame:
    """Return the means beside the runs: index table and algorithm, error [%] and time [s]."""
    rows = {
        (table, algorithm): means
        for table, by_algorithm in _printed()["run_means"].items()
        for algorithm, means in by_algorithm.items()
    }
    return _by_key(rows, ["table", "algorithm"], ["error_percent", "time_s"])


def fault_means() -> pd.DataFrame:
    """Return tables 19, 28, 37, 46, 55: index table and level, time [s] and error [%]."""
    rows = {
        (table, level): means
        for table, by_level in _printed()["fault_means"].items()
        for level, means in by_level.items()
    }
    return _by_key(rows, ["table", "level"], ["time_s", "error_percent"])


def overview(table: int) -> pd.DataFrame:
    """Return table 58 [%] or 59 [s].

    Returns
    -------
    pandas.DataFrame
        Index algorithm and level, and a last row ("mean", ""); columns the faults, "total" and
        "standard deviation".
    """
    printed = _printed()["overview"][table]
    rows = {
        (algorithm, level): printed[algorithm][level]
        for algorithm in ALGORITHMS
        for level in LEVELS
    }
    rows[MEAN, ""] = [*printed[MEAN], None, None]
    return _by_key(rows, ["algorithm", "level"], [*SINGLE_FAULTS, TOTAL, SIGMA])


def reliability_single() -> pd.DataFrame:
    """Return table 60.

    Returns
    -------
    pandas.DataFrame
        Index algorithm and "sum"; columns (fault or "total", "time x error" [s.%] or "RC" [%]).
    """
    printed = _printed()["reliability_single"]
    columns = pd.MultiIndex.from_product([[*SINGLE_FAULTS, TOTAL], ["time x error", "RC"]])
    rows = [[x for pair in printed[algorithm] for x in pair] for algorithm in ALGORITHMS]
    rows.append([x for product in printed[SUM] for x in (product, None)])
    index = pd.Index([*ALGORITHMS, SUM], name="algorithm")
    return pd.DataFrame(rows, index=index, columns=columns, dtype=float)


def reliability_multiple() -> pd.DataFrame:
    """Return table 61: index algorithm and "sum", time [s], error [%], product [s.%], RC [%]."""
    printed = _printed()["reliability_multiple"]
    rows = [printed[algorithm] for algorithm in ALGORITHMS]
    rows.append([None, None, printed[SUM], None])
    index = pd.Index([*ALGORITHMS, SUM], name="algorithm")
    columns = ["time_s", "error_percent", "time x error", "RC"]
    return pd.DataFrame(rows, index=index, columns=columns, dtype=float)


def _by_key(
    rows: dict[tuple[Any, str], list[Any]], names: list[str], columns: list[str]
) -> pd.DataFrame:
    index = pd.MultiIndex.from_tuples(list(rows), names=names)
    return pd.DataFrame(list(rows.values()), index=index, columns=columns, dtype=float)
