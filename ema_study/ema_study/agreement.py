"""Our errors beside the thesis's, fault by fault, and the time of an evaluation."""

from typing import Final

import numpy as np
import pandas as pd

from ema_study.cases import CASES, MULTIPLE, StudyCase
from ema_study.means import PRECISION_STUDY
from ema_study.printed import PRINTED, printed_runs
from ema_study.result import K
from ema_study.sources import MODEL_LABELS, NAMES_WITH_OWN_CODE, by_source, counted

ALGORITHM: Final = "pso"
"""The algorithm that is compared: the thesis's best, and Matlab's own rather than its author's."""

WITHIN: Final = "within"
BETTER: Final = "better"
WORSE: Final = "worse"
"""Verdicts on a mean error: in, below or above the range of the thesis's errors."""

_WINDOWS: Final = 10_000


def agreement(runs: pd.DataFrame) -> pd.DataFrame:
    """Compare the errors of particle swarm runs, fault by fault, with the thesis's.

    Parameters
    ----------
    runs
        Our runs, as of ``ema_study.result.as_frame``; may be incomplete or empty.

    Returns
    -------
    pandas.DataFrame
        Index: the names of ``CASES``; the multiple fault is that of the study of precision (table
        57). Columns (source, quantity). Of "printed": "component" that is faulty (empty for the
        multiple fault), its "true value", "runs", "lowest error [%]", "mean error [%]", "highest
        error [%]" and the "mean estimate" of the component. Of each of our models that has runs:
        "runs", "mean error [%]", "mean estimate" and "verdict": ``WITHIN`` the thesis's lowest to
        highest error, ``BETTER`` or ``WORSE``; empty without runs.
    """
    of_printed = printed_runs()
    of_models = by_source(runs)
    rows = {}
    for name, case in CASES.items():
        thesis = _of_case(of_printed, case)
        row = {(PRINTED, what): x for what, x in _printed_side(case, thesis).items()}
        for label in MODEL_LABELS.values():
            if label in of_models:
                ours = _of_case(of_models[label], case)
                side = _our_side(case, ours, thesis["error_percent"])
                row |= {(label, what): x for what, x in side.items()}
        rows[name] = row
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("fault")
    return table.rename_axis(["source", "quantity"], axis=1)


def time_per_10000_windows(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the time of 10,000 evaluations: the median over runs of tables 11 to 57 [s].

    A row an algorithm, the thesis's own DE and GWO in rows of their own; a column for "printed",
    whose evaluations are those of ``printed_runs``, and for each of our models that has runs.
    """
    everything = pd.concat([counted(printed_runs()), counted(runs)])
    time_s = _WINDOWS * everything["time_s"] / everything["evaluations"]
    table = time_s.groupby([everything["algorithm"], everything["model"]]).median().unstack()
    models = {PRINTED: PRINTED, **MODEL_LABELS}
    table = table.reindex(
        index=list(NAMES_WITH_OWN_CODE), columns=[one for one in models if one in table]
    )
    return table.rename(index=NAMES_WITH_OWN_CODE, columns=models).rename_axis(columns=None)


def _of_case(runs: pd.DataFrame, case: StudyCase) -> pd.DataFrame:
    """Return the particle swarm's runs of a case."""
    of_case = (runs["algorithm"] == ALGORITHM) & (runs["fault"] == case.fault)
    if case.fault == MULTIPLE:
        return runs[of_case & (runs["table"] == PRECISION_STUDY)]
    return runs[of_case & (runs["level"] == case.level)]


def _mean_of_component(case: StudyCase, runs: pd.DataFrame, prefix: str = "") -> float:
    return np.nan if case.component is None else runs[prefix + K[case.component]].mean()


def _printed_side(case: StudyCase, thesis: pd.DataFrame) -> dict[str, object]:
    errors = thesis["error_percent"]
    return {
        "component": "" if case.component is None else K[case.component],
        "true value": _mean_of_component(case, thesis, "true_"),
        "runs": len(thesis),
        "lowest error [%]": errors.min(),
        "mean error [%]": errors.mean(),
        "highest error [%]": errors.max(),
        "mean estimate": _mean_of_component(case, thesis),
    }


def _our_side(case: StudyCase, ours: pd.DataFrame, printed: pd.Series) -> dict[str, object]:
    error = ours["error_percent"].mean()
    # The thesis prints its errors to 0.01 %.
    if round(error, 2) < printed.min():
        verdict = BETTER
    else:
        verdict = WORSE if round(error, 2) > printed.max() else WITHIN
    return {
        "runs": len(ours),
        "mean error [%]": error,
        "mean estimate": _mean_of_component(case, ours),
        "verdict": "" if ours.empty else verdict,
    }
