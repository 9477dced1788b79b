"""What the thesis prints: its 500 runs of tables 9 to 57, and the figures of its other tables."""

from functools import cache
from importlib.resources import files
from itertools import product
from typing import Any, Final

import pandas as pd
import yaml

from ema_study.cases import LEVELS, SINGLE_FAULTS
from ema_study.plan import ALGORITHMS, GENERATIONS, POPULATION
from ema_study.stop_rules import uncounted_populations

PRINTED: Final = "printed"
"""Name of the thesis in place of a model's name."""

TOTAL: Final = "total"
SIGMA: Final = "standard deviation"
MEAN: Final = "mean"
SUM: Final = "sum"

SPEED_STUDY: Final = 56
PRECISION_STUDY: Final = 57
"""Tables of the two studies of the multiple fault."""

OVERVIEWS: Final[dict[int, str]] = {58: "error_percent", 59: "time_s"}
"""Column of the overviews by algorithm, level and fault, by table."""

SUMMARIES: Final[dict[int, str]] = dict(zip((19, 28, 37, 46, 55), SINGLE_FAULTS, strict=True))
"""Faults of the summary tables, by table."""


@cache
def _runs() -> pd.DataFrame:
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


def printed_runs() -> pd.DataFrame:
    """Return the thesis's runs as a table, one a row.

    The columns are those of ``ema_study.run.as_frame``, as far as the thesis prints them, with
    ``model`` "printed", and ``note``. ``evaluations`` follow: populations of 50, that of the start
    included, which GWO alone counts as a generation.

    Notes
    -----
    The true backlash is 0.747 as printed; its errors follow from 0.7474 (docs/errata.md).
    """
    return _runs().copy()


@cache
def _figures() -> dict[str, Any]:
    text = (files("ema_study") / "printed_tables.yaml").read_text(encoding="utf-8")
    return yaml.safe_load(text)


def ga_trials() -> pd.DataFrame:
    """Return table 8 by number of the trial: generations, time [s], settings."""
    trials = _figures()["ga_trials"]
    return pd.DataFrame(trials["rows"], columns=trials["columns"]).set_index("trial")


def run_means() -> pd.DataFrame:
    """Return the means beside the runs: index table and algorithm, error [%] and time [s]."""
    return _by_table("run_means", "algorithm", ["error_percent", "time_s"])


def fault_means() -> pd.DataFrame:
    """Return tables 19, 28, 37, 46, 55: index table and level, time [s] and error [%]."""
    return _by_table("fault_means", "level", ["time_s", "error_percent"])


def overview(table: int) -> pd.DataFrame:
    """Return table 58 [%] or 59 [s]: a row an algorithm and level, and a last row ("mean", "").

    The columns are the faults, "total" and "standard deviation".
    """
    printed = _figures()["overview"][table]
    rows = [printed[algorithm][level] for algorithm in ALGORITHMS for level in LEVELS]
    keys = [*product(ALGORITHMS, LEVELS), (MEAN, "")]
    index = pd.MultiIndex.from_tuples(keys, names=["algorithm", "level"])
    columns = [*SINGLE_FAULTS, TOTAL, SIGMA]
    means = [*printed[MEAN], None, None]
    return pd.DataFrame([*rows, means], index=index, columns=columns, dtype=float)


def reliability_single() -> pd.DataFrame:
    """Return table 60: index algorithm and "sum"; columns by fault, "time x error" and "RC"."""
    printed = _figures()["reliability_single"]
    columns = pd.MultiIndex.from_product([[*SINGLE_FAULTS, TOTAL], ["time x error", "RC"]])
    rows = [[x for pair in printed[algorithm] for x in pair] for algorithm in ALGORITHMS]
    return _with_sum(rows, [x for one in printed[SUM] for x in (one, None)], columns)


def reliability_multiple() -> pd.DataFrame:
    """Return table 61: index algorithm and "sum", time [s], error [%], product [s.%], RC [%]."""
    printed = _figures()["reliability_multiple"]
    columns = pd.Index(["time_s", "error_percent", "time x error", "RC"])
    rows = [printed[algorithm] for algorithm in ALGORITHMS]
    return _with_sum(rows, [None, None, printed[SUM], None], columns)


def _by_table(name: str, inner: str, columns: list[str]) -> pd.DataFrame:
    rows = {
        (table, key): row for table, block in _figures()[name].items() for key, row in block.items()
    }
    index = pd.MultiIndex.from_tuples(list(rows), names=["table", inner])
    return pd.DataFrame(list(rows.values()), index=index, columns=columns, dtype=float)


def _with_sum(rows: list[Any], last: list[Any], columns: pd.Index) -> pd.DataFrame:
    index = pd.Index([*ALGORITHMS, SUM], name="algorithm")
    return pd.DataFrame([*rows, last], index=index, columns=columns, dtype=float)
