"""Tests of a unit as a monitor would find them, without a monitor."""

from typing import Final

import numpy as np

from ema_core.faults import FAULT_NAMES, N_FAULTS, FaultVector, fault_vector
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.windows.trigger import Refusal

UNIT: Final = ("flap", "SIM-0001")
"""Actuator and serial number of the unit."""

FIRST_NS: Final = 1_700_000_000_000_000_000
PERIOD_NS: Final = 10_000_000_000
SIGMA: Final = 0.004
"""Standard deviation of the estimates [-]."""

_LONG_NS: Final = 500_000_000
_PHASE: Final = FAULT_NAMES.index("eccentricity_phase")


def estimate_at(
    number: float,
    rng: np.random.Generator | None = None,
    *,
    valid: bool = True,
    failed: bool = False,
    **faults: float,
) -> Estimate:
    """Return the estimate of test ``number``; with a generator it errs."""
    end_ns = FIRST_NS + round(number * PERIOD_NS)
    if not valid:
        reason = "a phase is open" if failed else "a gap of 3 samples"
        window = Refusal(end_ns - _LONG_NS, end_ns, reason)
        return refusal(window, "", SearchSettings(), reason, is_failure=failed)
    k = fault_vector(faults)
    if rng is not None:
        shown = np.array([name in faults for name in FAULT_NAMES])
        k = np.clip(k + np.where(shown, SIGMA * rng.standard_normal(N_FAULTS), 0.0), 0.0, 0.99)
    unobservable = np.zeros(N_FAULTS, dtype=bool)
    unobservable[_PHASE] = True
    covariance = SIGMA**2 * np.eye(N_FAULTS)
    covariance[_PHASE], covariance[:, _PHASE] = np.nan, np.nan
    return Estimate(
        end_ns - _LONG_NS,
        end_ns,
        "least_squares",
        0,
        "some-calibration",
        FaultVector.of(k),
        covariance,
        unobservable,
        play=-1.0,
        fitness=0.01,
        goodness_of_fit=1.0,
        goodness_limit=3.5,
        excitation=0.01,
        evaluations=200,
        computing_time_s=0.05,
        valid=True,
        reason="",
    )


def entry_at(number: int) -> Entry:
    """Return test ``number`` of a unit whose friction grows, as its history keeps it."""
    return Entry(estimate_at(number, friction=min(0.01 * number, 0.9)), 10.0 * number, number + 1)
