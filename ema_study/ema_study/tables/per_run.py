"""The tables that list runs: 9 to 18, 20 to 27, 29 to 36, 38 to 45, 47 to 54, 56 and 57."""

from typing import Final

import numpy as np
import pandas as pd

from ema_study.plan import ALGORITHMS, VARIANTS
from ema_study.printed_runs import PRINTED
from ema_study.printed_tables import MEAN, SIGMA, run_means
from ema_study.record import K
from ema_study.reliability import PRECISION_STUDY, SPEED_STUDY
from ema_study.sources import ALGORITHM_NAMES
from ema_study.tables.study_table import StudyTable
from ema_study.tables.threshold_notes import threshold_notes

QUANTITIES: Final = {
    **{k: k for k in K},
    "error_percent": "error [%]",
    "generations": "generations",
    "time_s": "time [s]",
}
"""What is shown of a run, by its column."""

TRUTH: Final = "truth"
PRINTED_MEAN: Final = "mean as printed"

_TITLES: Final = {
    9: "Friction low, DE with F = 0.5 and CR = 0.9",
    10: "Friction low, DE with F = 0.9 and CR = 0.95",
    SPEED_STUDY: "Multiple fault, study of speed",
    PRECISION_STUDY: "Multiple fault, study of precision",
}


def per_run_table(number: int, sources: dict[str, pd.DataFrame]) -> StudyTable:
    """Return the runs of a table, printed ones beside ours.

    Parameters
    ----------
    number
        Of the thesis's table.
    sources
        Runs by source, of ``ema_study.sources.by_source``.

    Returns
    -------
    StudyTable
        Rows: the truth, the runs, mean and standard deviation over them, and the mean as the thesis
        prints it; by algorithm where the table shows all four. Columns: ``QUANTITIES``.
    """
    of_table = {label: _of_table(number, runs) for label, runs in sources.items()}
    of_table = {label: runs for label, runs in of_table.items() if not runs.empty}
    algorithms = [
        algorithm for algorithm in ALGORITHMS if algorithm in set(of_table[PRINTED]["algorithm"])
    ]
    blocks = {
        label: pd.concat(
            {algorithm: _block(number, label, algorithm, runs) for algorithm in algorithms},
            names=["algorithm", "run"],
        )
        for label, runs in of_table.items()
    }
    frame = pd.concat(blocks, axis=1, names=["source", "quantity"]).reindex(
        _rows(algorithms, of_table)
    )
    if len(algorithms) == 1:
        frame = frame.droplevel("algorithm")
    notes = [_counts(of_table), *threshold_notes(number, of_table)]
    return StudyTable(number, _title(number, of_table[PRINTED]), frame, notes)


def _of_table(number: int, runs: pd.DataFrame) -> pd.DataFrame:
    """Return a table's runs; under the thesis's code, only those in which it differs."""
    of_table = runs[runs["table"] == number]
    if runs["own_code"].any():
        of_table = of_table[of_table["algorithm"].isin(list(VARIANTS))]
    return of_table.drop_duplicates(["algorithm", "run"], keep="last")


def _block(number: int, label: str, algorithm: str, runs: pd.DataFrame) -> pd.DataFrame:
    runs = runs[runs["algorithm"] == algorithm].sort_values("run")
    columns = list(QUANTITIES)
    block = runs.set_index(runs["run"].astype(str))[columns].astype(float)
    summary = pd.DataFrame({MEAN: block.mean(), SIGMA: block.std()}, index=columns, dtype=float).T
    truth = pd.DataFrame(np.nan, index=[TRUTH], columns=columns)
    if len(runs):
        truth.loc[TRUTH, K] = runs[[f"true_{k}" for k in K]].iloc[0].to_numpy(dtype=float)
    parts = [truth, block, summary]
    if label == PRINTED:
        means = run_means().loc[[(number, algorithm)]].set_axis([PRINTED_MEAN])
        parts.append(means.reindex(columns=columns))
    return pd.concat(parts).rename(columns=QUANTITIES)


def _rows(algorithms: list[str], of_table: dict[str, pd.DataFrame]) -> pd.MultiIndex:
    rows = []
    for algorithm in algorithms:
        numbers = sorted(
            {
                int(run)
                for runs in of_table.values()
                for run in runs.loc[runs["algorithm"] == algorithm, "run"]
            }
        )
        labels = [TRUTH, *map(str, numbers), MEAN, SIGMA, PRINTED_MEAN]
        rows += [(algorithm, label) for label in labels]
    return pd.MultiIndex.from_tuples(rows, names=["algorithm", "run"])


def _title(number: int, printed: pd.DataFrame) -> str:
    if number in _TITLES:
        return _TITLES[number]
    run = printed.iloc[0]
    fault = run["fault"].replace("_", " ").capitalize()
    return f"{fault} {run['level']}, {ALGORITHM_NAMES[run['algorithm']]}"


def _counts(of_table: dict[str, pd.DataFrame]) -> str:
    counts = "; ".join(f"{label} {len(runs)}" for label, runs in of_table.items())
    return f"Number of runs: {counts}."
