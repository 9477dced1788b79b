# SPDX-License-Identifier: Apache-2.0
"""Tests of lives as an estimator would report them, for the tests of the tracker."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS, FAULT_NAMES, HIGHEST, fault_vector, healthy_faults
from ema_monitor.identification.uncertainty import SIGNIFICANT_SIGMAS
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.outliers import GrowthEvent
from ema_monitor.prognosis.growth.prediction import TrackedFault
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_sim.growth import Growth, grow

SIGMA = 0.003
PHASE = FAULT_NAMES.index("eccentricity_phase")


def observed(
    hours: float,
    faults: Mapping[str, float] | NDArray[np.float64],
    rng: np.random.Generator | None = None,
    sigma: float = SIGMA,
    unobservable: Iterable[str] = (),
) -> Measurement:
    """Return a test of some faults; components that are not significant are set to healthy."""
    faults = fault_vector(faults)
    if rng is not None:
        faults = np.clip(faults + sigma * rng.standard_normal(8), 0.0, HIGHEST)
    healthy = healthy_faults()
    faults = np.where(np.abs(faults - healthy) < SIGNIFICANT_SIGMAS * sigma, healthy, faults)
    hidden = np.array([name in unobservable for name in FAULT_NAMES])
    hidden[PHASE] = True
    return Measurement(hours, faults, sigma**2 * np.eye(8), hidden)


def feed(
    tracker: Tracker,
    growths: Mapping[str, Growth],
    until: float,
    rng: np.random.Generator | None,
    faults: Mapping[str, float] | None = None,
    every: float = 10.0,
    after: float = 0.0,
) -> tuple[list[GrowthEvent], NDArray[np.float64]]:
    """Grow faults, test them every few hours, and return events and the last true faults."""
    k = fault_vector(faults or {})
    noise = np.random.default_rng(1)
    events: list[GrowthEvent] = []
    hours = after
    while hours + every <= until:
        k = grow(k, growths, hours, every, noise)
        hours += every
        events += tracker.update(observed(hours, k, rng))
    return events, k


def of(tracker: Tracker, name: str) -> TrackedFault:
    """Return the tracked state of a component."""
    return next(item for item in tracker.components() if item.name == name)


def growing(tracker: Tracker, name: str) -> float:
    """Return the probability that a component grows."""
    return 1.0 - tracker._mixture.constant()[COMPONENTS.index(name)]


def laws_of(tracker: Tracker, name: str) -> dict[str, float]:
    """Return the probability of each law of a component; a law under a wave counts as linear."""
    mixture, number = tracker._mixture, COMPONENTS.index(name)
    cells, selected = mixture.bank.cells, mixture.component == number
    laws = {law: mixture.weight[part][selected[part]].sum() for law, part in cells.slices.items()}
    laws["constant"] = 1.0 - growing(tracker, name)
    return laws | {"linear": 1.0 - sum(laws.values()) + laws["linear"]}
