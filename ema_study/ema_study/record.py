"""The result of a run, and runs as a table."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from ema_core.faults import N_FAULTS
from ema_study.cases import CASES
from ema_study.plan import Job

K: Final = [f"k{i}" for i in range(1, N_FAULTS + 1)]
"""Columns of the estimate; those of the truth begin with ``true_``."""


@dataclass(frozen=True)
class Record:
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

    @property
    def key(self) -> tuple[object, ...]:
        """What identifies the run within a study."""
        return self.job.key


def as_frame(records: Iterable[Record]) -> pd.DataFrame:
    """Return runs as a table, one a row, with the columns of the thesis's runs and more.

    Those of the job come first, its case as ``fault``; the truth is in ``true_k1`` to ``true_k8``,
    the estimate in ``k1`` to ``k8``.
    """
    rows: list[dict[str, Any]] = []
    for record in records:
        row = asdict(record)
        job, estimate = row.pop("job"), row.pop("estimate")
        case = CASES[job["case"]]
        job |= {"case": case.fault, "seed": record.job.seed}
        row["threshold"] = np.nan if record.threshold is None else record.threshold
        truth = dict(zip([f"true_{k}" for k in K], case.truth.tolist(), strict=True))
        rows.append(job | row | truth | dict(zip(K, estimate, strict=True)))
    return pd.DataFrame(rows).rename(columns={"case": "fault"})
