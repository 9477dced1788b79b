# SPDX-License-Identifier: Apache-2.0
"""Comparison with the thesis: errors for each fault, and evaluation time."""

from typing import Final

import numpy as np
import pandas as pd

from ema_study.cases import CASES, MULTIPLE, StudyCase
from ema_study.printed import PRECISION_STUDY, PRINTED, printed_runs
from ema_study.run import K
from ema_study.sources import MODEL_LABELS, NAMES_WITH_OWN_CODE, by_source, counted

ALGORITHM: Final = "pso"
"""Algorithm to compare: the thesis's best, as implemented by Matlab."""

WITHIN: Final = "within"
BETTER: Final = "better"
WORSE: Final = "worse"
"""Verdicts on a mean error relative to the thesis's range: within, below or above."""


def agreement(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a table that compares errors of particle swarm runs with the thesis's, by fault.

    The rows are ``CASES``; the multiple fault is taken from the study of precision (table 57). The
    columns are (source, quantity). The source "printed" has the faulty component, its true value,
    the number of runs, the lowest, mean and highest error, and the mean estimate. Each reproduced
    model has the number of runs, the mean error, the mean estimate and a verdict: ``WITHIN`` the
    range of the thesis's errors, ``BETTER`` or ``WORSE``. Models without runs are omitted; the
    verdict is empty for a fault without runs. For the multiple fault, the component is empty, and
    its value and estimates are NaN.
    """
    sources = by_source(runs)
    rows = {}
    for name, case in CASES.items():
        component = None if case.component is None else K[case.component]
        thesis = _of_case(sources[PRINTED], case)
        errors = thesis["error_percent"]
        row: dict[tuple[str, str], object] = {
            (PRINTED, "component"): component or "",
            (PRINTED, "true value"): thesis[f"true_{component}"].mean() if component else np.nan,
            (PRINTED, "runs"): len(thesis),
            (PRINTED, "lowest error [%]"): errors.min(),
            (PRINTED, "mean error [%]"): errors.mean(),
            (PRINTED, "highest error [%]"): errors.max(),
            (PRINTED, "mean estimate"): thesis[component].mean() if component else np.nan,
        }
        for label in MODEL_LABELS.values():
            if label in sources:
                ours = _of_case(sources[label], case)
                error = ours["error_percent"].mean()
                # The thesis prints its errors to 0.01 %.
                verdict = WORSE if round(error, 2) > errors.max() else WITHIN
                verdict = BETTER if round(error, 2) < errors.min() else verdict
                row[label, "runs"] = len(ours)
                row[label, "mean error [%]"] = error
                row[label, "mean estimate"] = ours[component].mean() if component else np.nan
                row[label, "verdict"] = "" if ours.empty else verdict
        rows[name] = row
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("fault")
    return table.rename_axis(["source", "quantity"], axis=1)


def time_per_10000_windows(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the median time of 10,000 model evaluations [s] over the runs of tables 11 to 57.

    The result has one row per algorithm, including the thesis's own DE and GWO. Columns are
    "printed", computed with the evaluations of ``printed_runs``, and each reproduced model with
    runs.
    """
    everything = pd.concat([counted(printed_runs()), counted(runs)])
    time_s = 10_000 * everything["time_s"] / everything["evaluations"]
    table = time_s.groupby([everything["algorithm"], everything["model"]]).median().unstack()
    models = {PRINTED: PRINTED, **MODEL_LABELS}
    table = table.reindex(
        index=list(NAMES_WITH_OWN_CODE), columns=[model for model in models if model in table]
    )
    return table.rename(index=NAMES_WITH_OWN_CODE, columns=models).rename_axis(columns=None)


def _of_case(runs: pd.DataFrame, case: StudyCase) -> pd.DataFrame:
    of_case = (runs["algorithm"] == ALGORITHM) & (runs["fault"] == case.fault)
    if case.fault == MULTIPLE:
        return runs[of_case & (runs["table"] == PRECISION_STUDY)]
    return runs[of_case & (runs["level"] == case.level)]
