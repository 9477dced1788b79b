"""Remaining useful life: what is told of it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class RemainingLife:
    """Quantiles of the remaining useful life under one criterion.

    Attributes
    ----------
    known
        Whether a figure can be given.
    hours_05, hours_50, hours_95
        5 %, 50 % and 95 % quantiles from the latest test on [h]; NaN when not known.
    criterion
        What ends life.
    reason
        Why no figure can be given; empty when known.
    """

    known: bool
    hours_05: float
    hours_50: float
    hours_95: float
    criterion: str
    reason: str = ""

    @classmethod
    def unknown(cls, criterion: str, reason: str) -> "RemainingLife":
        """Return a life of which no figure can be given."""
        return cls(False, math.nan, math.nan, math.nan, criterion, reason)

    @classmethod
    def of_samples(cls, hours: NDArray[np.float64], criterion: str) -> "RemainingLife":
        """Return the quantiles of samples of a life [h], ``(n,)``."""
        low, median, high = np.quantile(hours, [0.05, 0.5, 0.95], method="inverted_cdf")
        return cls(True, float(low), float(median), float(high), criterion)


@dataclass(frozen=True, eq=False)
class Prognosis:
    """Remaining useful life of an actuator, from its latest test on.

    Attributes
    ----------
    hours
        Service hour of the latest test [h]; NaN when there was none.
    components
        Life until each component reaches its limit, by name.
    overall
        Life until the first of them does.
    dominant_fault
        Component that does so first most often; empty when none is known to grow.
    samples
        Samples of the overall life [h], ``(n,)``; infinite when it is not known.
    duty
        Growth of the faults in a future flight hour, relative to a past one [-].
    assumption
        What is assumed of future use, in words.
    """

    hours: float
    components: Mapping[str, RemainingLife]
    overall: RemainingLife
    dominant_fault: str
    samples: NDArray[np.float64]
    duty: float
    assumption: str


@dataclass(frozen=True, eq=False)
class Fan:
    """Quantiles of the future of each component, for plots.

    Attributes
    ----------
    hours
        Hours from the latest test on [h], ``(m,)``.
    levels
        Probabilities of the quantiles [-], ``(q,)``.
    values
        Fault values by component [-], ``(q, m)`` each.
    """

    hours: NDArray[np.float64]
    levels: NDArray[np.float64]
    values: Mapping[str, NDArray[np.float64]]


def assumption_of(duty: float) -> str:
    """Return in words what a duty assumes of future use."""
    if duty == 1.0:
        return "future use as in the past"
    return f"faults grow {duty:g} times as fast in each future flight hour as in the past"
