"""What is known of each component after a test."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS, HIGHEST
from ema_monitor.prognosis.growth.check import PredictionCheck, TrackRecord
from ema_monitor.prognosis.growth.measurement import HEALTHY, INDICES
from ema_monitor.prognosis.growth.mixture import Mixture


@dataclass(frozen=True)
class TrackedFault:
    """What is known of one component.

    Attributes
    ----------
    name
        Component of the fault vector.
    tests
        Number of tests that showed it.
    value, sigma
        Mean and standard deviation, in the units of the fault vector [-]; NaN before any test.
    trend
        Growth of the value [1/h].
    trend_sigma
        Its standard deviation [1/h].
    laws
        Probability of each law [-]; ``constant`` stands for no growth yet.
    growing_probability
        Probability that it grows [-].
    calibration
        How its predictions held against the tests so far.
    """

    name: str
    tests: int
    value: float
    sigma: float
    trend: float
    trend_sigma: float
    laws: Mapping[str, float]
    growing_probability: float
    calibration: TrackRecord


def tracked_faults(
    mixture: Mixture, tests: NDArray[np.intp], check: PredictionCheck
) -> tuple[TrackedFault, ...]:
    """Return what is known of each component.

    Parameters
    ----------
    mixture
        What is thought of growth.
    tests
        Number of tests that showed each, ``(7,)``.
    check
        Predictions held against tests.
    """
    bank = mixture.bank
    cells, weight = bank.cells, bank.weight
    mean, variance = mixture.moments()
    rates = mixture.rates()
    share, own = mixture.waves.weight, mixture.waves.rates()
    trend = bank.sums(weight * rates) + np.sum(share * own, axis=1)
    squares = bank.sums(weight * (rates - trend[cells.component]) ** 2)
    squares += np.sum(share * (own - trend[:, None]) ** 2, axis=1)
    trend_sigma = np.sqrt(squares)
    figures = np.array([HEALTHY + mean, np.sqrt(variance), trend, trend_sigma])
    figures[:, tests == 0] = np.nan
    figures[0] = np.clip(figures[0], 0.0, HIGHEST[INDICES])
    laws = {
        law: np.bincount(cells.component[part], weight[part], len(COMPONENTS)).tolist()
        for law, part in cells.slices.items()
    }
    of_waves = np.sum(mixture.waves.weight * mixture.waves.grows, axis=1)
    laws["linear"] = (laws["linear"] + of_waves).tolist()
    laws["constant"] = mixture.constant().tolist()
    return tuple(
        TrackedFault(
            name,
            int(tests[i]),
            value,
            sigma,
            trend,
            trend_sigma,
            {law: share[i] for law, share in laws.items()},
            1.0 - laws["constant"][i],
            check.of(i),
        )
        for i, (name, (value, sigma, trend, trend_sigma)) in enumerate(
            zip(COMPONENTS, figures.T.tolist(), strict=True)
        )
    )
