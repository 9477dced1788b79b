"""The result of a run, and results as a table."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np
import pandas as pd

from ema_core.faults import N_FAULTS
from ema_study.cases import CASES
from ema_study.plan import Job

K: Final = [f"k{i}" for i in range(1, N_FAULTS + 1)]
"""Columns of the estimate; those of the truth begin with ``true_``."""


@dataclass(frozen=True)
class RunResult:
    """A run and its result.

    Attributes
    ----------
    job
        The run.
    estimate
        Fault vector, eight values.
    error_percent
        Error of the estimate in percent of the range (M14) [%].
    cost, cost_at_truth
        Of estimate and truth [A^2.s].
    threshold
        Cost at which the rule may stop [A^2.s]; None for a rule without one.
    generations, evaluations
        Numbers made; as in the thesis, the starting population counts as a generation of GWO only.
    time_s
        Time of the run on one core [s].
    costs, errors_percent
        Lowest cost so far [A^2.s] and the error of its point [%] after each generation, from the
        start on.
    """

    job: Job
    estimate: list[float]
    error_percent: float
    cost: float
    cost_at_truth: float
    threshold: float | None
    generations: int
    evaluations: int
    time_s: float
    costs: list[float]
    errors_percent: list[float]


def as_frame(results: Iterable[RunResult]) -> pd.DataFrame:
    """Return runs as a table, one a row, with the columns of the thesis's runs and more.

    Those of the job come first, its case as ``fault``; the truth is in ``true_k1`` to ``true_k8``,
    the estimate in ``k1`` to ``k8``.
    """
    rows = []
    for result in results:
        row = asdict(result)
        job, estimate = row.pop("job"), row.pop("estimate")
        case = CASES[job["case"]]
        job |= {"case": case.fault, "seed": result.job.seed}
        row["threshold"] = np.nan if result.threshold is None else result.threshold
        truth = zip([f"true_{k}" for k in K], case.truth.tolist(), strict=True)
        rows.append(job | row | dict(truth) | dict(zip(K, estimate, strict=True)))
    return pd.DataFrame(rows).rename(columns={"case": "fault"})
