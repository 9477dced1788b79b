# SPDX-License-Identifier: Apache-2.0
"""Synthetic runs of the study, for tables and figures that need many runs."""

import numpy as np
import pandas as pd

from ema_study.cases import CASES
from ema_study.plan import plan
from ema_study.run import RunResult, as_frame
from ema_study.stop_rules import uncounted_populations

FLOOR = 0.02
THRESHOLD = 0.021


def synthetic_runs(model: str, runs: int) -> pd.DataFrame:
    """Return runs of the whole plan, whose estimates are the truth with added noise."""
    rng = np.random.default_rng(1)
    results = []
    for job in plan(model, runs):
        truth = CASES[job.case].truth
        estimate = np.clip(truth + rng.normal(0.0, 0.02, truth.size), 0.0, 0.99)
        generations = int(rng.integers(5, 12))
        populations = generations + uncounted_populations(job.algorithm)
        fall = np.exp(-np.arange(populations) / 2.0)
        results.append(
            RunResult(
                job=job,
                estimate=estimate.tolist(),
                error_percent=float(rng.uniform(1.0, 4.0)),
                cost=FLOOR + float(fall[-1]),
                cost_at_truth=FLOOR,
                threshold=None if job.rule == "all_generations" else THRESHOLD,
                generations=generations,
                evaluations=50 * populations,
                time_s=float(rng.uniform(0.5, 1.5)),
                costs=(FLOOR + fall).tolist(),
                errors_percent=(2.0 + 80.0 * fall).tolist(),
            )
        )
    return as_frame(results)
