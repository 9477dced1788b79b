"""Whether our errors agree with the thesis's, fault by fault, and why not where they do not."""

from typing import Final

import numpy as np
import pandas as pd

from ema_study.agreement_reasons import reason
from ema_study.cases import CASES, MULTIPLE, StudyCase
from ema_study.causes import component
from ema_study.plan import ALGORITHMS, VARIANTS
from ema_study.printed_runs import PRINTED, printed_runs
from ema_study.record import K
from ema_study.reliability import PRECISION_STUDY
from ema_study.sources import ALGORITHM_NAMES, MODEL_LABELS, by_source, counted

ALGORITHM: Final = "pso"
"""The algorithm that is compared: the thesis's best, and Matlab's own rather than its author's."""

_WINDOWS = 10_000


def agreement(runs: pd.DataFrame) -> pd.DataFrame:
    """Compare the errors of particle swarm runs, fault by fault, with the thesis's.

    Parameters
    ----------
    runs
        Our runs, as of ``ema_study.record.as_frame``; may be incomplete or empty.

    Returns
    -------
    pandas.DataFrame
        Index: the names of ``CASES``; the multiple fault is that of the study of precision (table
        57). Columns (source, quantity). Of "printed": "component" that is faulty (empty for the
        multiple fault), its "true value", "runs", "lowest error [%]", "mean error [%]", "highest
        error [%]" and the "mean estimate" of the component. Of each of our models that has runs:
        "runs", "mean error [%]", "mean estimate", "within" (whether the mean error is between the
        thesis's lowest and highest, to 0.01 %; None without runs) and "reason" (why not; else
        empty).
    """
    ours = {
        label: frame for label, frame in by_source(runs).items() if label in MODEL_LABELS.values()
    }
    models = {label: model for model, label in MODEL_LABELS.items()}
    rows: dict[str, dict[tuple[str, str], object]] = {}
    for name, case in CASES.items():
        thesis = _of_case(printed_runs(), case)
        row: dict[tuple[str, str], object] = {
            (PRINTED, what): value for what, value in _printed_side(case, thesis).items()
        }
        for label, frame in ours.items():
            side = _our_side(models[label], case, _of_case(frame, case), thesis)
            row |= {(label, what): value for what, value in side.items()}
        rows[name] = row
    columns = pd.MultiIndex.from_tuples(
        list(next(iter(rows.values()))), names=["source", "quantity"]
    )
    cells = [list(row.values()) for row in rows.values()]
    table = pd.DataFrame(cells, index=pd.Index(list(rows), name="fault"), columns=columns)
    return table.astype({column: object for column in columns if column[1] == "within"})


def time_per_10000_windows(runs: pd.DataFrame) -> pd.DataFrame:
    """Return what 10,000 evaluations take: the median over runs, by algorithm [s].

    Parameters
    ----------
    runs
        Our runs; may be empty.

    Returns
    -------
    pandas.DataFrame
        Index the algorithms as called, the thesis's own DE and GWO apart; columns "printed" and
        the labels of our models. Runs of tables 11 to 57; the thesis's evaluations are those of
        ``printed_runs``.
    """
    columns = {PRINTED: _median_time(counted(printed_runs()))}
    ours = counted(runs)
    for model, label in MODEL_LABELS.items():
        if not ours.empty and (ours["model"] == model).any():
            columns[label] = _median_time(ours[ours["model"] == model])
    names = dict(ALGORITHM_NAMES)
    names |= {VARIANTS[name]: f"{ALGORITHM_NAMES[name]}, thesis's code" for name in VARIANTS}
    table = pd.DataFrame(columns).reindex([*ALGORITHMS, *VARIANTS.values()])
    return table.rename(index=names).rename_axis("algorithm")


def _median_time(runs: pd.DataFrame) -> pd.Series:
    return (_WINDOWS * runs["time_s"] / runs["evaluations"]).groupby(runs["algorithm"]).median()


def _of_case(runs: pd.DataFrame, case: StudyCase) -> pd.DataFrame:
    """Return the particle swarm's runs of a case."""
    of_case = (runs["algorithm"] == ALGORITHM) & (runs["fault"] == case.fault)
    if case.fault == MULTIPLE:
        return runs[of_case & (runs["table"] == PRECISION_STUDY)]
    return runs[of_case & (runs["level"] == case.level)]


def _component(case: StudyCase) -> str | None:
    """Return the column of the one faulty component; None of the multiple fault."""
    place = component(case.name)
    return None if place is None else K[place]


def _printed_side(case: StudyCase, thesis: pd.DataFrame) -> dict[str, object]:
    column = _component(case)
    errors = thesis["error_percent"]
    return {
        "component": column or "",
        "true value": thesis[f"true_{column}"].mean() if column else np.nan,
        "runs": len(thesis),
        "lowest error [%]": errors.min(),
        "mean error [%]": errors.mean(),
        "highest error [%]": errors.max(),
        "mean estimate": thesis[column].mean() if column else np.nan,
    }


def _our_side(
    model: str, case: StudyCase, ours: pd.DataFrame, thesis: pd.DataFrame
) -> dict[str, object]:
    column = _component(case)
    error = ours["error_percent"].mean()
    lowest, highest = thesis["error_percent"].min(), thesis["error_percent"].max()
    # The thesis prints its errors to 0.01 %.
    within = None if ours.empty else bool(lowest <= round(error, 2) <= highest)
    return {
        "runs": len(ours),
        "mean error [%]": error,
        "mean estimate": ours[column].mean() if column else np.nan,
        "within": within,
        "reason": reason(model, case, ours, thesis) if within is False else "",
    }
