"""False alarms on healthy windows, and the smallest fault that is detected."""

from collections import Counter
from statistics import NormalDist
from typing import Any, Final

import cases
import numpy as np
from cases import DETECTABLE
from exactness import Healthy, Sizes
from numpy.typing import NDArray
from trials import Job, Variant, Workers

from ema_core.faults import FAULT_NAMES, healthy_faults
from ema_core.levels import ERROR, WARN
from ema_monitor.health import HealthLimits, assess
from ema_monitor.identification.estimate import Estimate

FAMILY_RATE: Final = 0.01
"""Probability that the stricter test alarms on any of the seven faults of a healthy window, if the
estimates were Gaussian with the covariance that they report [-]."""

TESTS: Final = {
    "strict": NormalDist().inv_cdf(1.0 - FAMILY_RATE / len(DETECTABLE) / 2.0),
    "2 sigma": 2.0,
}
"""Standard deviations from healthy beyond which a small fault counts as detected: two-sided after
Bonferroni, and as it is read off an estimate. How often either alarms on healthy windows is
measured."""

POWER: Final = 0.9
"""Share of windows in which a step counts as detected [-]."""

STEPS_PERCENT: Final = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
"""Sizes of a fault that are tried one after the other, in percent of the range."""


def measure(workers: Workers, healthy: Healthy, sizes: Sizes) -> dict[str, Any]:
    """Return false alarms and, by fault, the power at each step and the smallest one detected."""
    noisy = [Variant(healthy.noisy, noisy=True)]
    jobs = [Job(case, noisy) for case in cases.healthy(sizes.healthy)]
    found = [estimate for [estimate] in workers.estimates("healthy windows, alarms", jobs)]
    levels = Counter(assess(e, HealthLimits()).level if e.valid else "not valid" for e in found)
    deviations = np.array([_deviations(estimate) for estimate in found])
    away: dict[int, dict[float, NDArray[np.float64]]] = {fault: {} for fault in DETECTABLE}
    for percent in STEPS_PERCENT:
        # What every test has detected at a smaller step is not tried again.
        left = [f for f in DETECTABLE if _smallest(away[f], max(TESTS.values())) == np.inf]
        jobs = [
            Job(case, noisy)
            for fault in left
            for case in cases.step(fault, percent / 100.0, sizes.steps)
        ]
        if not jobs:
            break
        found = workers.estimates(f"faults of {percent:g} %", jobs)
        for i, fault in enumerate(left):
            part = found[i * sizes.steps : (i + 1) * sizes.steps]
            column = DETECTABLE.index(fault)
            away[fault][percent] = np.array([_deviations(one)[column] for [one] in part])
    return {
        "windows": sizes.healthy,
        "warnings": levels[WARN],
        "errors": levels[ERROR],
        "not_valid": levels["not valid"],
        "largest_deviation_sigma": float(np.max(deviations)),
        "windows_a_step": sizes.steps,
        "tests": {
            name: {
                "z": z,
                "alarms": int(np.sum(np.any(deviations > z, axis=1))),
                "power": {
                    FAULT_NAMES[fault]: {p: float(np.mean(d > z)) for p, d in by_step.items()}
                    for fault, by_step in away.items()
                },
                "smallest_percent": {
                    FAULT_NAMES[fault]: _smallest(by_step, z) for fault, by_step in away.items()
                },
            }
            for name, z in TESTS.items()
        },
    }


def _smallest(by_step: dict[float, NDArray[np.float64]], z: float) -> float:
    """Return the smallest step detected with the power wanted [%]; inf where none was."""
    detected = (percent for percent, away in by_step.items() if np.mean(away > z) >= POWER)
    return next(detected, float("inf"))


def _deviations(estimate: Estimate) -> list[float]:
    """Return how many standard deviations each fault is away from healthy."""
    away = np.abs(estimate.faults - healthy_faults()) / estimate.sigma
    return np.nan_to_num(away)[list(DETECTABLE)].tolist()
