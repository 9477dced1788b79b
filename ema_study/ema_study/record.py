"""What a run of the study found, and runs as a table."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd

from ema_core.faults import N_FAULTS

K: list[str] = [f"k{i}" for i in range(1, N_FAULTS + 1)]
"""Columns of the estimate; those of the truth begin with ``true_``."""


@dataclass(frozen=True)
class Record:
    """A run and its result.

    Attributes
    ----------
    model
        Name of the monitor model, one of ``ema_study.models.MODELS``.
    table
        Number of the thesis's table that the run belongs to.
    algorithm
        Registered name of the optimizer.
    fault, level
        Kind and level of the fault, as in the thesis's runs; the level of the multiple fault names
        the study: "fast_stop" (table 56) or "stall_stop" (table 57).
    run
        Running number, from 1.
    rule
        Name of the stop rule.
    population, max_generations
        Of the optimizer.
    settings
        Further settings of the optimizer, by name.
    seed
        Of its random numbers.
    truth, estimate
        Fault vectors, eight values.
    error_percent
        Error of the estimate in percent of the range (M14).
    cost, cost_at_truth
        Of estimate and truth [A^2.s].
    threshold
        Cost at which the rule may stop [A^2.s]; None where it knows none.
    generations, evaluations
        How many were made; as in the thesis, the starting population counts as a generation of GWO
        only.
    time_s
        Time of the run on one core [s].
    costs, errors_percent
        Lowest cost so far [A^2.s] and the error of its point [%] after each generation, from the
        start on.
    """

    model: str
    table: int
    algorithm: str
    fault: str
    level: str
    run: int
    rule: str
    population: int
    max_generations: int
    settings: dict[str, float]
    seed: int
    truth: list[float]
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


def as_frame(records: Iterable[Record]) -> pd.DataFrame:
    """Return runs as a table, one a row, with the columns of the thesis's runs and more.

    Truth and estimate are spread over ``true_k1`` to ``true_k8`` and ``k1`` to ``k8``.
    """
    rows: list[dict[str, Any]] = []
    for record in records:
        row = asdict(record)
        truth, estimate = row.pop("truth"), row.pop("estimate")
        row["threshold"] = np.nan if record.threshold is None else record.threshold
        row |= dict(zip([f"true_{k}" for k in K], truth, strict=True))
        row |= dict(zip(K, estimate, strict=True))
        rows.append(row)
    return pd.DataFrame(rows)
