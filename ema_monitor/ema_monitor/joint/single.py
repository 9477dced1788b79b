"""Comparing a single figure of a record with that of the healthy records."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple, Self

import numpy as np

from ema_monitor.joint.scatter import Prediction, Scatter

BETWEEN_RECORDS: Final = 0.6
"""Prior medians of standard deviations between records of a day, over those between days [-]."""

SIGNIFICANCE: Final = 1e-3
"""Probability below which a healthy record differs in one quantity or figure."""

DOUBT: Final = 3e-3
"""Probability below which a record is not called healthy: three standard deviations of a normal.

Few records predict with wider tails: there three standard deviations are not rare.
"""

POWER: Final = 0.9
"""Probability with which the smallest detectable change is found."""

INTERVAL: Final = (0.05, 0.95)

Z90: Final = 1.645
"""Standard deviations from the middle to either end of a 90 % interval."""


class Observation(NamedTuple):
    """A figure of one record: its value, the standard deviation of its error, and its day."""

    value: float
    sigma: float
    day: int


class SingleTest(NamedTuple):
    """A figure of a record beside its prediction from the healthy records."""

    value: float
    prediction: Prediction

    @classmethod
    def of(cls, observation: Observation, scatter: Scatter) -> Self:
        """Return the test of a figure with the scatter of the healthy records."""
        return cls(observation.value, scatter.predict(observation.sigma**2, observation.day))

    @property
    def change(self) -> float:
        """Value less the predicted one."""
        return self.value - self.prediction.mean

    @property
    def interval(self) -> tuple[float, float]:
        """90 % interval of the change."""
        low, high = self.prediction.interval(INTERVAL)
        return self.value - high, self.value - low

    @property
    def probability(self) -> float:
        """Probability that a healthy record differs as much."""
        return self.prediction.probability(self.value)

    @property
    def is_significant(self) -> bool:
        """Whether the figure has changed."""
        return self.probability < SIGNIFICANCE

    @property
    def is_doubtful(self) -> bool:
        """Whether the change is beyond usual variation, but not certain."""
        return SIGNIFICANCE <= self.probability < DOUBT

    @property
    def smallest_change(self) -> float:
        """Smallest change that would be detected."""
        return self.prediction.smallest_change(SIGNIFICANCE, POWER)

    def less(self, part: float) -> Self:
        """Return the test without a part of the value that has another explanation."""
        return self._replace(value=self.value - part)


def scatter_of(healthy: Sequence[Observation], between_days: float) -> Scatter:
    """Return the scatter of healthy records; ``between_days`` is its prior median between days."""
    return Scatter(
        np.array([observation.value for observation in healthy]),
        np.array([observation.sigma**2 for observation in healthy]),
        [observation.day for observation in healthy],
        BETWEEN_RECORDS * between_days,
        between_days,
    )


def is_known(*values: float) -> bool:
    """Return whether all values are finite."""
    return all(map(math.isfinite, values))
