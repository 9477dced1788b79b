"""False alarms on healthy windows, and the smallest fault that is detected."""

from collections import Counter
from typing import Any, Final

import cases
import numpy as np
from cases import DETECTABLE
from exactness import Healthy, Sizes
from trials import Job, Variant, Workers

from ema_core.faults import FAULT_NAMES, healthy_faults
from ema_core.levels import ERROR, WARN
from ema_monitor.estimate import Estimate
from ema_monitor.health import HealthLimits, assess

Z: Final = 2.0
"""Standard deviations from healthy at which a small fault counts as detected; how many healthy
windows have any fault beyond it is measured."""

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
    power: dict[int, dict[float, float]] = {fault: {} for fault in DETECTABLE}
    for percent in STEPS_PERCENT:
        # What was detected at a smaller step is not tried again.
        left = [f for f, by_step in power.items() if max(by_step.values(), default=0.0) < POWER]
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
            hits = [_deviations(estimate)[DETECTABLE.index(fault)] > Z for [estimate] in part]
            power[fault][percent] = float(np.mean(hits))
    return {
        "windows": sizes.healthy,
        "warnings": levels[WARN],
        "errors": levels[ERROR],
        "not_valid": levels["not valid"],
        "z": Z,
        "family_alarms": int(np.sum(np.any(deviations > Z, axis=1))),
        "largest_deviation_sigma": float(np.max(deviations)),
        "windows_a_step": sizes.steps,
        "power": {FAULT_NAMES[fault]: by_step for fault, by_step in power.items()},
        "smallest_percent": {
            FAULT_NAMES[fault]: next(
                (percent for percent, share in by_step.items() if share >= POWER), float("inf")
            )
            for fault, by_step in power.items()
        },
    }


def _deviations(estimate: Estimate) -> list[float]:
    """Return how many standard deviations each fault is away from healthy."""
    away = np.abs(estimate.faults - healthy_faults()) / estimate.sigma
    return np.nan_to_num(away)[list(DETECTABLE)].tolist()
