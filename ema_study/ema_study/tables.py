# SPDX-License-Identifier: Apache-2.0
"""Tables 8 to 61 of the thesis with printed and reproduced values side by side."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import pandas as pd

from ema_study.cases import ALGORITHMS, LEVELS, SINGLE_FAULTS
from ema_study.contents import NUMBERS, title_of
from ema_study.plan import VARIANTS
from ema_study.printed import (
    MEAN,
    MULTIPLE_RELIABILITY,
    OVERVIEWS,
    PRECISION_STUDY,
    PRINTED,
    SIGMA,
    SINGLE_RELIABILITY,
    SPEED_STUDY,
    SUM,
    SUMMARIES,
    TOTAL,
    TRIALS,
    printed_table,
)
from ema_study.run import K
from ema_study.sources import MODEL_LABELS, PRINTED_RUNS, by_source, single_fault_runs

Sources: TypeAlias = Mapping[str, pd.DataFrame]

_OF_RUN: Final = [*K, "error_percent", "generations", "time_s"]
_OF_TRIAL: Final = ["population", "max_generations", "generations", "time_s", "speed", "fault"]
_HEADINGS: Final = {
    "error_percent": "error [%]",
    "time_s": "time [s]",
    "time_limit_s": "time limit [s]",
    "max_generations": "most generations",
    "speed": "evaluations per second",
    "time x error": "time x error [s.%]",
    "RC": "RC [%]",
}
_MEANS: Final = {"time_s": "mean time [s]", "error_percent": "mean error [%]"}
_MIXED: Final = f"times of table {SPEED_STUDY}, errors of {PRECISION_STUDY}"


@dataclass(frozen=True)
class StudyTable:
    """A table of the thesis, with printed and reproduced values side by side."""

    number: int
    """Number of the table in the thesis."""
    frame: pd.DataFrame
    """Table with columns (source, quantity) and the rows of the thesis.

    Missing values are NaN. A mean over means is NaN if any mean is missing.
    """
    note: str = ""
    """Note on how to read the table; may be empty."""

    @property
    def title(self) -> str:
        """Title of the table."""
        return title_of(self.number)


def study_tables(runs: pd.DataFrame, numbers: Sequence[int] = NUMBERS) -> list[StudyTable]:
    """Return tables of the thesis, with printed and reproduced values side by side.

    Parameters
    ----------
    runs
        Runs as ``ema_study.run.as_frame`` returns them, of one or both models; may be incomplete
        or empty.
    numbers
        Numbers of the tables, in the order of the result; 8 to 61 by default.
    """
    sources = by_source(runs)
    # Some values computed from the thesis's runs differ from the values that it prints.
    computed = {
        PRINTED_RUNS if label == PRINTED else label: part for label, part in sources.items()
    }

    def table(number: int) -> StudyTable:
        if number == TRIALS:
            return _trials(runs)
        if number in SUMMARIES:
            return _fault_summary(number, computed)
        if number in OVERVIEWS:
            return _overview(number, computed)
        if number == SINGLE_RELIABILITY:
            return _single_fault_reliability(computed)
        if number == MULTIPLE_RELIABILITY:
            return _multiple_fault_reliability(computed)
        return _per_run(number, sources)

    return [table(number) for number in numbers]


def write_tables(tables: Iterable[StudyTable], folder: Path) -> list[Path]:
    """Write each table as ``table_<number>.csv``, and return the paths.

    The columns are "source: quantity".
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for table in tables:
        written.append(folder / f"table_{table.number:02d}.csv")
        columns = [": ".join(map(str, column)) for column in table.frame.columns]
        table.frame.set_axis(columns, axis=1).to_csv(written[-1], float_format="%.7g")
    return written


def _trials(runs: pd.DataFrame) -> StudyTable:
    """Return table 8, the trials of GA, with one row per trial."""
    trials = printed_table("trials")
    is_bound = trials["at_least"].astype(bool)
    printed = _with_speed(trials)[[*_OF_TRIAL, "tolerance", "time_limit_s", "parallel"]]
    printed.loc[is_bound, "speed"] = np.nan
    blocks = {PRINTED: printed}
    for model, label in MODEL_LABELS.items():
        ours = runs if runs.empty else runs[(runs["table"] == TRIALS) & (runs["model"] == model)]
        if not ours.empty:
            ours = ours.drop_duplicates("run", keep="last").set_index("run")
            blocks[label] = _with_speed(ours)[[*_OF_TRIAL, "error_percent"]]
    bounds = ", ".join(str(trial) for trial in trials.index[is_bound])
    note = (
        f"The times of trials {bounds} are lower bounds. The thesis prints neither the level of "
        "its faults nor the fault of every trial; ours are at the low level."
    )
    return _side_by_side(TRIALS, blocks, _HEADINGS, note)


def _with_speed(trials: pd.DataFrame) -> pd.DataFrame:
    speed = trials["population"] * trials["generations"] / trials["time_s"]
    return trials.assign(speed=speed)


def _per_run(number: int, sources: Sources) -> StudyTable:
    """Return a table of runs: truth, runs, mean and deviation over runs, and the printed mean.

    Rows are grouped by algorithm if the table contains several algorithms.
    """
    of_table = {}
    for label, runs in sources.items():
        chosen = runs[runs["table"] == number]
        # Only DE and GWO of the thesis's own code differ from the source without it.
        if runs["own_code"].any():
            chosen = chosen[chosen["algorithm"].isin(list(VARIANTS))]
        if not chosen.empty:
            of_table[label] = chosen.drop_duplicates(["algorithm", "run"], keep="last")
    printed = of_table[PRINTED]
    algorithms = [name for name in ALGORITHMS if name in set(printed["algorithm"])]
    frames = []
    for algorithm in algorithms:
        blocks = {label: _runs_of(algorithm, runs) for label, runs in of_table.items()}
        means = printed_table("run_means").loc[[(number, algorithm)]]
        blocks[PRINTED] = pd.concat([blocks[PRINTED], means.set_axis(["mean as printed"])])
        runs = {int(row) for block in blocks.values() for row in block.index if row.isdigit()}
        rows = ["truth", *map(str, sorted(runs)), MEAN, SIGMA, "mean as printed"]
        frames.append(pd.concat(blocks, axis=1, names=["source", "quantity"]).reindex(rows))
    frame = pd.concat(frames, keys=algorithms, names=["algorithm", "run"])
    frame = frame.rename(columns=_HEADINGS, level="quantity")
    if len(algorithms) == 1:
        frame = frame.droplevel("algorithm")
    return StudyTable(number, frame)


def _runs_of(algorithm: str, runs: pd.DataFrame) -> pd.DataFrame:
    """Return rows with truth, runs, mean and deviation for one algorithm."""
    runs = runs[runs["algorithm"] == algorithm].sort_values("run")
    block = runs.set_index(runs["run"].astype(str))[_OF_RUN].astype(float)
    truth = pd.DataFrame(np.nan, index=["truth"], columns=_OF_RUN)
    if len(runs):
        truth.loc["truth", K] = runs[[f"true_{k}" for k in K]].iloc[0].to_numpy(dtype=float)
    summary = pd.DataFrame({MEAN: block.mean(), SIGMA: block.std()}, dtype=float).T
    return pd.concat([truth, block, summary])


def _fault_summary(number: int, sources: Sources) -> StudyTable:
    """Return the mean over the four algorithms' means for a fault, with one row per level."""
    fault = SUMMARIES[number]

    def mean(runs: pd.DataFrame, quantity: str) -> pd.Series:
        means = overview_of(runs, quantity)[fault].drop(index=(MEAN, ""))
        return means.unstack("level")[list(LEVELS)].mean(skipna=False)

    blocks = {PRINTED: printed_table("fault_means").loc[[number]].droplevel("table")}
    for label, runs in sources.items():
        blocks[label] = pd.DataFrame({quantity: mean(runs, quantity) for quantity in _MEANS})
    return _side_by_side(number, blocks, _MEANS)


def _overview(number: int, sources: Sources) -> StudyTable:
    """Return table 58 or 59: mean errors or times for each algorithm, level and fault."""
    quantity = OVERVIEWS[number]
    blocks = {PRINTED: printed_table(f"table_{number}")}
    blocks |= {label: overview_of(runs, quantity) for label, runs in sources.items()}
    note = f"{TOTAL.capitalize()} and {SIGMA} refer to the five means to the left."
    return _side_by_side(number, blocks, lambda name: name.replace("_", " "), note)


def _single_fault_reliability(sources: Sources) -> StudyTable:
    """Return table 60 (reliability, single faults)."""
    blocks = {PRINTED: printed_table("table_60")}
    for label, runs in sources.items():
        times, errors = (overview_of(runs, quantity) for quantity in _MEANS)
        blocks[label] = reliability_of_overviews(times, errors)
    for label, block in blocks.items():
        names = [f"{fault.replace('_', ' ')}, {_HEADINGS[x]}" for fault, x in block.columns]
        blocks[label] = block.set_axis(names, axis=1)
    return _side_by_side(SINGLE_RELIABILITY, blocks)


def _multiple_fault_reliability(sources: Sources) -> StudyTable:
    """Return table 61 as computed in the thesis, and computed from each of the two studies."""
    blocks = {PRINTED: printed_table("table_61")}
    for label, runs in sources.items():
        for label_of_tables, times_of, errors_of in (
            (_MIXED, SPEED_STUDY, PRECISION_STUDY),
            (f"table {SPEED_STUDY}", SPEED_STUDY, SPEED_STUDY),
            (f"table {PRECISION_STUDY}", PRECISION_STUDY, PRECISION_STUDY),
        ):
            block = multiple_fault_reliability(runs, times_of, errors_of)
            blocks[f"{label}, {label_of_tables}"] = block
    note = f"As printed, it multiplies the {_MIXED}: no run had both."
    return _side_by_side(MULTIPLE_RELIABILITY, blocks, _HEADINGS, note)


def _side_by_side(
    number: int, blocks: dict[str, pd.DataFrame], names: Any = None, note: str = ""
) -> StudyTable:
    """Return the tables of several sources side by side, with the rows of the printed table."""
    frame = pd.concat(blocks, axis=1, names=["source", "quantity"])
    frame = frame.reindex(blocks[PRINTED].index).rename(columns=names or {}, level="quantity")
    return StudyTable(number, frame, note)


def overview_of(runs: pd.DataFrame, quantity: str) -> pd.DataFrame:
    """Return the means of a column over runs, with the layout of tables 58 and 59.

    ``quantity`` is the column, such as "error_percent". A mean over means is NaN if any mean is
    missing. The standard deviation is the sample standard deviation (n - 1).
    """
    means = single_fault_runs(runs).groupby(["algorithm", "level", "fault"])[quantity].mean()
    rows = pd.MultiIndex.from_product([ALGORITHMS, LEVELS], names=["algorithm", "level"])
    cells = means.unstack("fault").reindex(index=rows, columns=list(SINGLE_FAULTS)).astype(float)
    table = cells.assign(
        **{TOTAL: cells.mean(axis=1, skipna=False), SIGMA: cells.std(axis=1, skipna=False)}
    )
    table.loc[(MEAN, ""), :] = cells.mean(skipna=False)
    return table.rename_axis(columns=None)


def with_coefficients(times: pd.Series, errors: pd.Series) -> pd.DataFrame:
    """Return time [s], error [%], their product and reliability coefficient of each algorithm.

    The reliability coefficient is ``100 (1 - p_i / sum p)`` of the products p_i [%] (section 7.3 of
    the thesis). It compares algorithms: all coefficients are NaN if a product is missing. The last
    row has the sum of the products.
    """
    table = pd.DataFrame({"time_s": times, "error_percent": errors, "time x error": times * errors})
    total = table["time x error"].sum(skipna=False)
    table["RC"] = 100.0 * (1.0 - table["time x error"] / total)
    table.loc[SUM, "time x error"] = total
    return table.rename_axis("algorithm")


def reliability_of_overviews(times: pd.DataFrame, errors: pd.DataFrame) -> pd.DataFrame:
    """Return table 60 from the times of table 59 [s] and the errors of table 58 [%].

    As in the thesis, time and error are means over both levels.
    """
    times, errors = (
        table.groupby(level="algorithm").sum(min_count=len(LEVELS)).loc[list(ALGORITHMS)]
        / len(LEVELS)
        for table in (times, errors)
    )
    blocks = {
        fault: with_coefficients(times[fault], errors[fault])[["time x error", "RC"]]
        for fault in (*SINGLE_FAULTS, TOTAL)
    }
    return pd.concat(blocks, axis=1)


def multiple_fault_reliability(runs: pd.DataFrame, times_of: int, errors_of: int) -> pd.DataFrame:
    """Return table 61, computed from the times of one table and the errors of another.

    The thesis combines the times of the study of speed (56) and the errors of the study of
    precision (57), which come from different runs.
    """

    def means(table: int, quantity: str) -> pd.Series:
        of_table = runs[runs["table"] == table]
        return of_table.groupby("algorithm")[quantity].mean().reindex(list(ALGORITHMS))

    return with_coefficients(means(times_of, "time_s"), means(errors_of, "error_percent"))
