# SPDX-License-Identifier: Apache-2.0
"""Comparison of a single figure of a record with the healthy records."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Self

import numpy as np

from ema_monitor.joint.scatter import Prediction, Scatter

BETWEEN_RECORDS: Final = 0.6
"""Ratio of the prior medians of the standard deviations within a day and between days [-]."""

SIGNIFICANCE: Final = 1e-3
"""Probability under the healthy records below which a quantity or figure counts as changed."""

DOUBT: Final = 3e-3
"""Probability below which a record is not reported as healthy.

For a normal distribution, it corresponds to three standard deviations. The limit is a probability
because predictions from few records have wider tails.
"""

POWER: Final = 0.9
"""Probability with which the smallest detectable change is detected."""

INTERVAL: Final = (0.05, 0.95)
"""Probabilities at the ends of a 90 % interval."""

Z90: Final = 1.645
"""Half-width of a 90 % interval in standard deviations."""


class Observation(NamedTuple):
    """A figure of one record: its value, the standard deviation of its error, and its day."""

    value: float
    sigma: float
    day: int


class SingleTest(NamedTuple):
    """Comparison of a figure of a record with its prediction from the healthy records."""

    value: float
    prediction: Prediction

    @classmethod
    def of(cls, observation: Observation, scatter: Scatter) -> Self:
        """Return the test of an observation against the scatter of the healthy records."""
        return cls(observation.value, scatter.predict(observation.sigma**2, observation.day))

    @property
    def change(self) -> float:
        """Measured minus predicted value."""
        return self.value - self.prediction.mean

    @property
    def interval(self) -> tuple[float, float]:
        """90 % interval of the change."""
        low, high = self.prediction.interval(INTERVAL)
        return self.value - high, self.value - low

    @property
    def probability(self) -> float:
        """Probability that a healthy record differs at least as much."""
        return self.prediction.probability(self.value)

    @property
    def is_significant(self) -> bool:
        """Whether the figure has changed."""
        return self.probability < SIGNIFICANCE

    @property
    def is_doubtful(self) -> bool:
        """Whether the change exceeds usual variation, but is not significant."""
        return SIGNIFICANCE <= self.probability < DOUBT

    @property
    def smallest_change(self) -> float:
        """Smallest change that is detected with the probability ``POWER``."""
        return self.prediction.smallest_change(SIGNIFICANCE, POWER)

    def less(self, part: float) -> Self:
        """Return the test without the part of the value that has a different explanation."""
        return self._replace(value=self.value - part)


def scatter_of(healthy: Sequence[Observation], between_days: float) -> Scatter:
    """Return the scatter model of a figure, fitted to healthy records.

    Parameters
    ----------
    healthy
        The figure in each healthy record.
    between_days
        Prior median of the standard deviation between days, in the unit of the figure.
    """
    return Scatter(
        np.array([observation.value for observation in healthy]),
        np.array([observation.sigma**2 for observation in healthy]),
        [observation.day for observation in healthy],
        BETWEEN_RECORDS * between_days,
        between_days,
    )


def are_finite(*values: float) -> bool:
    """Return whether all values are finite."""
    return all(map(math.isfinite, values))
