"""What a bank of filters tells of each component: its level, its trend, its laws."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS, HIGHEST
from ema_core.growth_laws import increment
from ema_monitor.prognosis.growth.bank import Bank
from ema_monitor.prognosis.growth.measurement import HEALTHY, INDICES


@dataclass(frozen=True)
class TrackedFault:
    """What is known of one component.

    Attributes
    ----------
    name
        Component of the fault vector.
    tests
        Number of tests that told of it.
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
    """

    name: str
    tests: int
    value: float
    sigma: float
    trend: float
    trend_sigma: float
    laws: Mapping[str, float]
    growing_probability: float


def tracked_faults(bank: Bank, tests: NDArray[np.intp]) -> tuple[TrackedFault, ...]:
    """Return what is known of each component.

    Parameters
    ----------
    bank
        The filters.
    tests
        Number of tests that told of each component, ``(7,)``.
    """
    cells, weight = bank.cells, bank.weight
    mean, variance = bank.moments()
    rates = np.zeros_like(weight)
    for law, part in cells.slices.items():
        x = np.clip(cells.side[part] * bank.mean[part], 0.0, 1.0)
        an_hour = increment(law, x, cells.rate[part], cells.shape[part], 1.0)
        rates[part] = np.minimum(an_hour, 1.0)
    rates *= cells.side
    trend = bank.sums(weight * rates)
    trend_sigma = np.sqrt(bank.sums(weight * (rates - trend[cells.component]) ** 2))
    laws = {
        law: np.bincount(cells.component[part], weight[part], len(COMPONENTS))
        for law, part in cells.slices.items()
    }
    unknown = tests == 0
    figures = (HEALTHY + mean, np.sqrt(variance), trend, trend_sigma)
    value, sigma, trend, trend_sigma = (np.where(unknown, np.nan, item) for item in figures)
    return tuple(
        TrackedFault(
            name,
            int(tests[number]),
            float(np.clip(value[number], 0.0, HIGHEST[INDICES[number]])),
            float(sigma[number]),
            float(trend[number]),
            float(trend_sigma[number]),
            {law: float(share[number]) for law, share in laws.items()},
            1.0 - float(laws["constant"][number]),
        )
        for number, name in enumerate(COMPONENTS)
    )
