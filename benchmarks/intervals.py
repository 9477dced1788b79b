"""Whether the covariance is honest: how often intervals cover, and how wide they are."""

from statistics import NormalDist
from typing import Any, Final

import numpy as np
from bounds import Bound
from exactness import Trial
from trials import difference

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, FAULT_NAMES, N_FAULTS

LEVEL: Final = 0.9
"""Probability that an interval is meant to cover the truth with [-]."""

SMALLEST_ZETA: Final = 0.05
"""Eccentricity above which its phase is judged [-]."""


def coverage(trial: Trial, bounds: list[Bound]) -> dict[str, Any]:
    """Return how often the intervals cover the truth, and their width over that of the bound.

    Components are pooled; those that an estimate calls unobservable have no interval.

    Parameters
    ----------
    trial
        Cases and estimates.
    bounds
        The Cramer-Rao bound of each case.
    """
    z = NormalDist().inv_cdf((1.0 + LEVEL) / 2.0)
    truth = np.array([case.faults for case in trial.cases])
    sigma = np.array([estimate.sigma for estimate in trial.estimates])
    away = np.array(
        [difference(e.faults, c.faults) for c, e in zip(trial.cases, trial.estimates, strict=True)]
    )
    best = np.array([bound.sigma for bound in bounds])
    judged = np.ones_like(truth, dtype=bool)
    judged[:, ECCENTRICITY_PHASE] = truth[:, ECCENTRICITY] > SMALLEST_ZETA
    known = judged & np.isfinite(sigma)
    inside = np.abs(away) <= z * sigma
    by_component = {
        FAULT_NAMES[i]: {
            "coverage": _mean(inside[known[:, i], i]),
            "half_width_percent": 100.0 * z * _median(sigma[known[:, i], i]),
            "bound_half_width_percent": 100.0 * z * _median(best[known[:, i], i]),
        }
        for i in range(N_FAULTS)
    }
    width, best_width = (100.0 * z * _median(values[known]) for values in (sigma, best))
    return {
        "intervals": int(np.sum(known)),
        "unobservable": int(np.sum(judged & ~known)),
        "coverage": _mean(inside[known]),
        "half_width_percent": width,
        "bound_half_width_percent": best_width,
        "width_over_bound": width / best_width,
        "median_ratio_to_bound": _median(sigma[known] / best[known]),
        "by_component": by_component,
    }


def _mean(values) -> float:
    return float(np.mean(values)) if np.size(values) else float("nan")


def _median(values) -> float:
    return float(np.median(values)) if np.size(values) else float("nan")
