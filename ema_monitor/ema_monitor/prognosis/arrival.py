"""What a test tells of each tracked component, beside what was expected."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import FAULT_NAMES, healthy_faults
from ema_monitor.prognosis.near_healthy import REACH
from ema_monitor.prognosis.observation import Observation
from ema_monitor.prognosis.settings import COMPONENTS

INDICES: Final = [FAULT_NAMES.index(name) for name in COMPONENTS]
"""Where the tracked components are in a fault vector."""
HEALTHY: Final = healthy_faults()[INDICES]


@dataclass(frozen=True, eq=False)
class Arrival:
    """A test's signed distances from healthy, of the components tracked, ``(7,)`` each.

    Attributes
    ----------
    hours
        Service hour of the test [h].
    value
        Distance from healthy [-].
    covariance
        Covariance of its error, ``(7, 7)``; zero in rows and columns of what is not seen.
    seen
        Components that the test tells of.
    near_healthy
        Those of them that were put back to healthy.
    """

    hours: float
    value: NDArray[np.float64]
    covariance: NDArray[np.float64]
    seen: NDArray[np.bool_]
    near_healthy: NDArray[np.bool_]

    @classmethod
    def of(cls, observation: Observation, sigma_floor: float) -> "Arrival":
        """Return what an observation tells, with an error floor [-] beside its covariance."""
        seen = ~observation.unobservable[INDICES]
        covariance = observation.covariance[np.ix_(INDICES, INDICES)]
        covariance = np.where(np.outer(seen, seen), np.nan_to_num(covariance), 0.0)
        covariance += sigma_floor**2 * np.eye(len(INDICES))
        value = np.where(seen, observation.faults[INDICES] - HEALTHY, 0.0)
        return cls(observation.hours, value, covariance, seen, observation.at_healthy[INDICES])

    @property
    def noise(self) -> NDArray[np.float64]:
        """Variances of the errors, ``(7,)``."""
        return np.diag(self.covariance)

    def level(self, number: int) -> tuple[float, float]:
        """Return distance and variance of a component by this test alone."""
        return float(self.value[number]), float(self.noise[number])

    def surprise(
        self, mean: NDArray[np.float64], variance: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return how many standard deviations each value is from what was expected, ``(7,)``."""
        away = np.abs(self.value - mean)
        reach = np.where(self.near_healthy, REACH * np.sqrt(self.noise), 0.0)
        total = np.sqrt(self.noise + variance)
        return np.where(self.seen, np.maximum(away - reach, 0.0) / total, 0.0)

    def without_common_errors(
        self,
        mean: NDArray[np.float64],
        variance: NDArray[np.float64],
        plain: NDArray[np.bool_],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return values and error variances, given what all other components tell, ``(7,)`` each.

        Errors of one test are correlated: that the others lie off what was expected of them tells
        part of the error of each (the conditional Gaussian distribution).

        Parameters
        ----------
        mean, variance
            What was expected.
        plain
            Components whose value is that of the test and not merely near healthy.
        """
        value, noise = self.value.copy(), self.noise.copy()
        total = self.covariance + np.diag(variance)
        for number in np.flatnonzero(plain):
            others = plain.copy()
            others[number] = False
            if not np.any(self.covariance[number, others]):
                continue
            shared = self.covariance[number, others]
            factor = np.linalg.solve(total[np.ix_(others, others)], shared)
            value[number] -= factor @ (self.value - mean)[others]
            noise[number] = max(noise[number] - factor @ shared, 0.01 * noise[number])
        return value, noise
