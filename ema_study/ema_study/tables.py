"""The thesis's tables 8 to 61 beside ours."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
import pandas as pd

from ema_study.cases import LEVELS, SINGLE_FAULTS
from ema_study.plan import ALGORITHMS, VARIANTS
from ema_study.printed import (
    MEAN,
    OVERVIEWS,
    PRECISION_STUDY,
    PRINTED,
    SIGMA,
    SPEED_STUDY,
    SUM,
    SUMMARIES,
    TOTAL,
    fault_means,
    ga_trials,
    overview,
    reliability_multiple,
    reliability_single,
    run_means,
)
from ema_study.run import K
from ema_study.sources import (
    ALGORITHM_NAMES,
    MODEL_LABELS,
    PRINTED_RUNS,
    by_source,
    single_fault_runs,
)

Sources: TypeAlias = Mapping[str, pd.DataFrame]

_OF_RUN: Final = {
    **{k: k for k in K},
    "error_percent": "error [%]",
    "generations": "generations",
    "time_s": "time [s]",
}
_OF_TRIAL: Final = {
    "population": "population",
    "max_generations": "most generations",
    "generations": "generations",
    "time_s": "time [s]",
    "speed": "evaluations per second",
}
_MEANS: Final = {"time_s": "mean time [s]", "error_percent": "mean error [%]"}
_OF_RELIABILITY: Final = {
    "time x error": "time x error [s.%]",
    "RC": "RC [%]",
    "time_s": "time [s]",
    "error_percent": "error [%]",
}
_MIXED: Final = f"times of table {SPEED_STUDY}, errors of {PRECISION_STUDY}"
_TITLES: Final = {
    9: "Friction low, DE with F = 0.5 and CR = 0.9",
    10: "Friction low, DE with F = 0.9 and CR = 0.95",
    SPEED_STUDY: "Multiple fault, study of speed",
    PRECISION_STUDY: "Multiple fault, study of precision",
}


@dataclass(frozen=True)
class StudyTable:
    """A table of the thesis, by its number, beside ours.

    ``frame`` has columns (source, quantity) and the rows of the thesis, NaN where there is nothing;
    ``note`` says how to read it. A mean over means is empty where one is missing.
    """

    number: int
    title: str
    frame: pd.DataFrame
    note: str = ""


def study_tables(runs: pd.DataFrame) -> list[StudyTable]:
    """Return the thesis's tables 8 to 61, in their order, each beside ours.

    Parameters
    ----------
    runs
        Our runs, as of ``ema_study.run.as_frame``: one model or both, complete or not, or none.
    """
    sources = by_source(runs)
    tables = [
        _trials(runs),
        *(_per_run(number, sources) for number in run_means().index.unique("table")),
        *(_fault_summary(number, sources) for number in SUMMARIES),
        *(_overview(number, sources) for number in OVERVIEWS),
        _single_fault_reliability(sources),
        _multiple_fault_reliability(sources),
    ]
    return sorted(tables, key=lambda table: table.number)


def write_tables(tables: Iterable[StudyTable], folder: Path) -> list[Path]:
    """Write each table as ``table_<number>.csv``, with columns "source: quantity"."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for table in tables:
        written.append(folder / f"table_{table.number:02d}.csv")
        columns = [": ".join(map(str, column)) for column in table.frame.columns]
        table.frame.set_axis(columns, axis=1).to_csv(written[-1], float_format="%.7g")
    return written


def _trials(runs: pd.DataFrame) -> StudyTable:
    """Return table 8: the trials of GA; of ours, the number of a run is that of its trial."""
    trials = ga_trials()
    shown = _OF_TRIAL | {
        "failure": "fault",
        "tolerance": "tolerance",
        "time_limit_s": "time limit [s]",
        "parallel": "parallel",
    }
    printed = _with_speed(trials).rename(columns=shown)[list(shown.values())]
    is_bound = trials["at_least"].astype(bool)
    printed.loc[is_bound, "evaluations per second"] = np.nan
    blocks = {PRINTED: printed}
    shown = _OF_TRIAL | {"fault": "fault", "error_percent": "error [%]"}
    for model, label in MODEL_LABELS.items():
        ours = runs if runs.empty else runs[(runs["table"] == 8) & (runs["model"] == model)]
        if not ours.empty:
            ours = ours.drop_duplicates("run", keep="last").set_index("run")
            blocks[label] = _with_speed(ours).rename(columns=shown)[list(shown.values())]
    bounds = ", ".join(str(trial) for trial in trials.index[is_bound])
    note = (
        f"The times of trials {bounds} are lower bounds. The thesis prints neither the level of "
        "its faults nor the fault of every trial; ours are at the low level."
    )
    return StudyTable(8, "Calibration of GA", _side_by_side(blocks), note)


def _with_speed(trials: pd.DataFrame) -> pd.DataFrame:
    speed = trials["population"] * trials["generations"] / trials["time_s"]
    return trials.assign(speed=speed)


def _per_run(number: int, sources: Sources) -> StudyTable:
    """Return a table of runs: truth, runs, mean and deviation over them, and the printed mean.

    They are grouped by algorithm where the table shows all four.
    """
    of_table = {label: _runs_of_table(number, runs) for label, runs in sources.items()}
    of_table = {label: runs for label, runs in of_table.items() if not runs.empty}
    printed = of_table[PRINTED]
    algorithms = [name for name in ALGORITHMS if name in set(printed["algorithm"])]
    frames = []
    for algorithm in algorithms:
        blocks = {label: _runs_of(algorithm, runs) for label, runs in of_table.items()}
        means = run_means().loc[[(number, algorithm)]].rename(columns=_OF_RUN)
        blocks[PRINTED] = pd.concat([blocks[PRINTED], means.set_axis(["mean as printed"])])
        runs = {int(row) for block in blocks.values() for row in block.index if row.isdigit()}
        rows = ["truth", *map(str, sorted(runs)), MEAN, SIGMA, "mean as printed"]
        frames.append(pd.concat(blocks, axis=1, names=["source", "quantity"]).reindex(rows))
    frame = pd.concat(frames, keys=algorithms, names=["algorithm", "run"])
    if len(algorithms) == 1:
        frame = frame.droplevel("algorithm")
    run = printed.iloc[0]
    title = f"{_in_words(run['fault'])} {run['level']}, {ALGORITHM_NAMES[run['algorithm']]}"
    return StudyTable(number, _TITLES.get(number, title), frame)


def _runs_of_table(number: int, runs: pd.DataFrame) -> pd.DataFrame:
    """Return a table's runs; of the thesis's own code, only DE and GWO, where it differs."""
    of_table = runs[runs["table"] == number]
    if runs["own_code"].any():
        of_table = of_table[of_table["algorithm"].isin(list(VARIANTS))]
    return of_table.drop_duplicates(["algorithm", "run"], keep="last")


def _runs_of(algorithm: str, runs: pd.DataFrame) -> pd.DataFrame:
    """Return truth, runs, mean and deviation of an algorithm in a table, a row each."""
    runs = runs[runs["algorithm"] == algorithm].sort_values("run")
    block = runs.set_index(runs["run"].astype(str))[list(_OF_RUN)].astype(float)
    truth = pd.DataFrame(np.nan, index=["truth"], columns=list(_OF_RUN))
    if len(runs):
        truth.loc["truth", K] = runs[[f"true_{k}" for k in K]].iloc[0].to_numpy(dtype=float)
    summary = pd.DataFrame({MEAN: block.mean(), SIGMA: block.std()}, dtype=float).T
    return pd.concat([truth, block, summary]).rename(columns=_OF_RUN)


def _fault_summary(number: int, sources: Sources) -> StudyTable:
    """Return the means of a fault over all four algorithms, by level."""
    fault = SUMMARIES[number]
    blocks = {PRINTED: fault_means().loc[[number]].droplevel("table")}
    blocks |= {label: fault_means_of(runs, fault) for label, runs in _computed(sources).items()}
    frame = _side_by_side(blocks).rename(columns=_MEANS, level="quantity")
    return StudyTable(number, f"{_in_words(fault)}, mean over the algorithms", frame)


def _overview(number: int, sources: Sources) -> StudyTable:
    """Return mean errors or times by algorithm, level and fault."""
    quantity = OVERVIEWS[number]
    blocks = {PRINTED: overview(number)}
    blocks |= {label: overview_of(runs, quantity) for label, runs in _computed(sources).items()}
    frame = _side_by_side(blocks).rename(columns=lambda name: name.replace("_", " "), level=1)
    note = f"{TOTAL.capitalize()} and {SIGMA} are of the five means to the left."
    title = f"{_MEANS[quantity].capitalize()} by algorithm, level and fault"
    return StudyTable(number, title, frame, note)


def _single_fault_reliability(sources: Sources) -> StudyTable:
    """Return table 60."""
    blocks = {PRINTED: reliability_single()}
    for label, runs in _computed(sources).items():
        overviews = overview_of(runs, "time_s"), overview_of(runs, "error_percent")
        blocks[label] = reliability_of_overviews(*overviews)
    for label, block in blocks.items():
        names = [f"{fault.replace('_', ' ')}, {_OF_RELIABILITY[x]}" for fault, x in block.columns]
        blocks[label] = block.set_axis(names, axis=1)
    return StudyTable(60, "Reliability coefficient, single faults", _side_by_side(blocks))


def _multiple_fault_reliability(sources: Sources) -> StudyTable:
    """Return table 61 as the thesis computed it, and from each of its two studies alone."""
    blocks = {PRINTED: reliability_multiple()}
    for label, runs in _computed(sources).items():
        for what, times_of, errors_of in (
            (_MIXED, SPEED_STUDY, PRECISION_STUDY),
            (f"table {SPEED_STUDY}", SPEED_STUDY, SPEED_STUDY),
            (f"table {PRECISION_STUDY}", PRECISION_STUDY, PRECISION_STUDY),
        ):
            blocks[f"{label}, {what}"] = multiple_fault_reliability(runs, times_of, errors_of)
    note = f"As printed, it multiplies the {_MIXED}: no run had both."
    frame = _side_by_side(blocks).rename(columns=_OF_RELIABILITY, level="quantity")
    return StudyTable(61, "Reliability coefficient, multiple fault", frame, note)


def _computed(sources: Sources) -> Sources:
    """Return the sources under the labels of figures computed from runs."""
    return {PRINTED_RUNS if label == PRINTED else label: runs for label, runs in sources.items()}


def _side_by_side(blocks: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Return one table of those of several sources; the first one gives the rows."""
    first = next(iter(blocks.values()))
    return pd.concat(blocks, axis=1, names=["source", "quantity"]).reindex(first.index)


def _in_words(fault: str) -> str:
    return fault.replace("_", " ").capitalize()


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
    """Return ``100 (1 - p_i / sum p)`` of products of time and error by algorithm [%].

    Section 7.3 of the thesis. It compares algorithms: all are NaN where one is missing.
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
    """Return table 60, as ``printed.reliability_single``, of tables 59 [s] and 58 [%].

    Time and error are means over both levels, as in the thesis.
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
    """Return table 61 with times and errors of given tables.

    The thesis uses the times of the study of speed (56) and the errors of the study of precision
    (57), which no run had together.
    """

    def means(table: int, quantity: str) -> pd.Series:
        of_table = runs[runs["table"] == table]
        return of_table.groupby("algorithm")[quantity].mean().reindex(list(ALGORITHMS))

    return with_coefficients(means(times_of, "time_s"), means(errors_of, "error_percent"))
