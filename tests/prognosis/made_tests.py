# SPDX-License-Identifier: Apache-2.0
"""Synthetic estimates of tests, as a monitor would identify them, and their histories."""

from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from ema_core.faults import FAULT_NAMES, N_FAULTS, FaultVector, fault_vector
from ema_monitor.identification.estimate import Estimate, refusal
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import Entry
from ema_monitor.reasons import NoCalibration, StatedReason
from ema_monitor.windows.trigger import Refusal

UNIT = ("flap", "SIM-0001")
FIRST_NS = 1_700_000_000_000_000_000
PERIOD_NS = 10_000_000_000
SIGMA = 0.004
PHASE = FAULT_NAMES.index("eccentricity_phase")


def made_test(
    number: float,
    *,
    valid: bool = True,
    failed: bool = False,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    **faults: float,
) -> Estimate:
    """Return the estimate of test ``number``; with a seed, its errors have a sigma of 0.004."""
    end_ns = FIRST_NS + round(number * PERIOD_NS)
    if not valid:
        reason = "a phase is open" if failed else "a gap of 3 samples"
        window = Refusal(end_ns - 500_000_000, end_ns, StatedReason(reason))
        return refusal(
            window,
            NoCalibration("calibration.yaml"),
            SearchSettings(),
            StatedReason(reason),
            is_failure=failed,
        )
    k = fault_vector(faults)
    if seed is not None:
        rng = np.random.default_rng([seed, round(number)])
    if rng is not None:
        errors = SIGMA * rng.standard_normal(N_FAULTS)
        k = np.clip(k + np.where([name in faults for name in FAULT_NAMES], errors, 0.0), 0.0, 0.99)
    unobservable = np.zeros(N_FAULTS, dtype=bool)
    unobservable[PHASE] = True
    covariance = SIGMA**2 * np.eye(N_FAULTS)
    covariance[PHASE], covariance[:, PHASE] = np.nan, np.nan
    return Estimate(
        end_ns - 500_000_000,
        end_ns,
        "least_squares",
        0,
        "some-calibration",
        FaultVector.of(k),
        covariance,
        unobservable,
        play_offset=-1.0,
        fitness=0.01,
        goodness_of_fit=1.0,
        goodness_limit=3.5,
        excitation=0.01,
        evaluations=200,
        computing_time=0.05,
        valid=True,
    )


def hiding(test: Estimate, hidden: Collection[str]) -> Estimate:
    """Return the same test with hidden faults, which look healthy."""
    unobservable = test.unobservable | np.isin(FAULT_NAMES, list(hidden))
    covariance = test.covariance.copy()
    covariance[unobservable] = covariance[:, unobservable] = np.nan
    return replace(test, unobservable=unobservable, covariance=covariance)


def entry(number: int) -> Entry:
    return Entry(made_test(number, friction=min(0.01 * number, 0.9)), 10.0 * number, number + 1)


def history_of(
    estimates: Iterable[Estimate], path: Path | None = None, unit: tuple[str, str] = UNIT
) -> History:
    """Return a history of tests at intervals of ten hours, without assessments."""
    history = History(*unit, path)
    for number, estimate in enumerate(estimates, 1):
        history.append(Entry(estimate, 10.0 * number, number))
    return history


def kept(path: Path, n: int = 3) -> bytes:
    """Write a history of n tests to a file; return the content of the file."""
    history = History(*UNIT, path)
    for number in range(n):
        history.append(entry(number))
    history.close()
    return path.read_bytes()


def hours(path: Path, unit: tuple[str, str] = UNIT) -> tuple[list[float], str]:
    history = History(*unit, path)
    history.close()
    return [item.hours for item in history.entries], history.problem
