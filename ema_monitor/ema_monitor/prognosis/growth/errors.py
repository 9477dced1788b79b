"""Size and correlation of the errors of a unit's estimates, learnt from its tests.

The errors of an estimate are those of its covariance times a factor, and follow an AR(1) process
from test to test. Factor and correlation are on a grid: each pair has a Kalman filter of its own
for each component, of level and a rate that wanders, and its probability is the likelihood of all
tests by them. These filters assume no law, so that a wrong one is not taken for lasting errors.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY

CORRELATIONS: Final = np.array([0.0, 0.25, 0.5, 0.75])
"""Correlations of the errors of successive tests on the grid [-]."""

FACTORS: Final = np.array([0.5, 0.7, 1.0, 1.4, 2.0])
"""Factors of the standard deviations of the estimates on the grid [-]."""

_FACTOR_SIGMA: Final = 0.35
_UNCORRELATED: Final = 0.5

_RATE_SIGMA: Final = 1e-3
"""Standard deviation of a rate before any test [1/h]."""

_RATE_WALK: Final = 0.02
"""Relative random walk of a rate [1/sqrt(h)]."""

_LEAST_RATE: Final = 3e-5
"""Rate below which the walk is that of this one [1/h]."""


def _log_prior() -> NDArray[np.float64]:
    correlated = np.full(CORRELATIONS.size, (1.0 - _UNCORRELATED) / (CORRELATIONS.size - 1))
    correlated[0] = _UNCORRELATED
    size = -0.5 * (np.log(FACTORS) / _FACTOR_SIGMA) ** 2
    return np.log(correlated)[:, None] + size


@dataclass(frozen=True, eq=False)
class LastTest:
    """The test before, by component, ``(7,)`` each.

    Attributes
    ----------
    value, noise
        Its signed distances from healthy [-] and variances of their errors.
    used
        Components whose levels it measured.
    """

    value: NDArray[np.float64]
    noise: NDArray[np.float64]
    used: NDArray[np.bool_]

    @classmethod
    def none(cls) -> "LastTest":
        """Return that before any test."""
        n = len(COMPONENTS)
        return cls(np.zeros(n), np.ones(n), np.zeros(n, dtype=bool))

    def carried(self, noise: NDArray[np.float64], correlation: float) -> NDArray[np.float64]:
        """Return the factor c by which its errors last in a test of given variances, ``(7,)``."""
        return np.where(self.used, correlation * np.sqrt(noise / self.noise), 0.0)


class EstimateErrors:
    """Probabilities of size and correlation of the errors of a unit's estimates.

    Attributes
    ----------
    log_probability
        Their logarithms, up to a constant, ``(4, 5)``.
    mean, covariance
        Level and rate of each component by each pair, ``(7, 4, 5, 2)`` and ``(7, 4, 5, 2, 2)``.
    hours
        Hours since each component was last measured [h], ``(7,)``; infinite when it is to start.
    """

    def __init__(self, noise_hours: float) -> None:
        self._noise_hours = noise_hours
        self.log_probability = _log_prior()
        n, shape = len(COMPONENTS), (CORRELATIONS.size, FACTORS.size)
        self.mean = np.zeros((n, *shape, 2))
        self.covariance = np.zeros((n, *shape, 2, 2))
        self.hours = np.full(n, np.inf)

    @property
    def probability(self) -> NDArray[np.float64]:
        """Probabilities of correlations and factors, ``(4, 5)``."""
        p = np.exp(self.log_probability - self.log_probability.max())
        return p / p.sum()

    @property
    def correlation(self) -> float:
        """Mean correlation of the errors of successive tests [-]."""
        return float(CORRELATIONS @ self.probability.sum(axis=1))

    @property
    def factor(self) -> float:
        """Mean factor of the standard deviations [-]."""
        return float(FACTORS @ self.probability.sum(axis=0))

    def advance(self, hours: NDArray[np.float64]) -> None:
        """Count the hours of growth since the tests, ``(7,)`` [h]."""
        self.hours = self.hours + hours

    def restart(self, number: int) -> None:
        """Begin anew with a component at its next test: its level has changed."""
        self.hours = self.hours.copy()
        self.hours[number] = np.inf

    def learn(
        self,
        value: NDArray[np.float64],
        noise: NDArray[np.float64],
        used: NDArray[np.bool_],
        last: LastTest,
        occasional: tuple[float, float],
    ) -> None:
        """Learn from a test.

        Parameters
        ----------
        value, noise
            Signed distances from healthy and variances of their errors, ``(7,)``.
        used
            Components that the test measures, ``(7,)``.
        last
            The test before.
        occasional
            Standard deviation and probability of an occasional error [-].
        """
        begins = np.flatnonzero(used & ~np.isfinite(self.hours))
        self.mean[begins] = 0.0
        self.mean[begins, ..., 0] = value[begins, None, None]
        self.covariance[begins] = 0.0
        self.covariance[begins, ..., 0, 0] = noise[begins, None, None] * FACTORS**2
        self.covariance[begins, ..., 1, 1] = _RATE_SIGMA**2
        goes_on = np.flatnonzero(used & np.isfinite(self.hours))
        if goes_on.size:
            log_p = self._measure(goes_on, value, noise, last, occasional)
            self.log_probability = self.log_probability + np.sum(log_p, axis=0)
            self.log_probability -= self.log_probability.max()
        self.hours = np.where(used, 0.0, self.hours)

    def _measure(
        self,
        at: NDArray[np.intp],
        value: NDArray[np.float64],
        noise: NDArray[np.float64],
        last: LastTest,
        occasional: tuple[float, float],
    ) -> NDArray[np.float64]:
        """Update some components; return the logarithms of the likelihoods, ``(m, 4, 5)``."""
        hours = self.hours[at, None, None]
        follows = last.used[at, None, None]
        c = CORRELATIONS[:, None] * np.sqrt(noise[at] / last.noise[at])[:, None, None] * follows
        fresh = np.where(follows, 1.0 - CORRELATIONS[:, None] ** 2, 1.0) * FACTORS**2
        mean, p = self.mean[at], self.covariance[at]
        level, rate = mean[..., 0], mean[..., 1]
        walk = _RATE_WALK**2 * (rate**2 + _LEAST_RATE**2) * hours
        # Level and rate after the hours, and the noise of growth in them.
        across = p[..., 0, 1] + hours * p[..., 1, 1]
        q = rate**2 * self._noise_hours * hours + walk * hours**2 / 3.0
        variance = p[..., 0, 0] + hours * (p[..., 0, 1] + across) + q
        shared_rate = across + walk * hours / 2.0
        moved = p[..., 0, 0] + hours * p[..., 0, 1]
        innovation = value[at, None, None] - level - hours * rate
        innovation = innovation - c * (last.value[at, None, None] - level)
        usual = variance - 2.0 * c * moved + c**2 * p[..., 0, 0]
        usual = np.maximum(usual, 0.0) + fresh * noise[at, None, None]
        wide = usual + occasional[0] ** 2
        log_usual = np.log1p(-occasional[1]) + _log_normal(innovation, usual)
        log_wide = np.log(max(occasional[1], LEAST_PROBABILITY)) + _log_normal(innovation, wide)
        log_p = np.logaddexp(log_usual, log_wide)
        share = np.exp(log_wide - log_p)
        shared = np.stack([variance - c * moved, shared_rate - c * p[..., 0, 1]], axis=-1)
        gain = 1.0 / usual + share * (1.0 / wide - 1.0 / usual)
        both = share * (1.0 - share) * (1.0 / usual - 1.0 / wide) ** 2 * innovation**2
        after = np.stack([level + hours * rate, rate], axis=-1)
        self.mean[at] = after + shared * (gain * innovation)[..., None]
        grown = np.empty_like(p)
        grown[..., 0, 0], grown[..., 1, 1] = variance, p[..., 1, 1] + walk
        grown[..., 0, 1] = grown[..., 1, 0] = shared_rate
        outer = shared[..., None] * shared[..., None, :]
        self.covariance[at] = grown - outer * (gain - both)[..., None, None]
        return log_p


def _log_normal(away: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    return -0.5 * (away**2 / variance + np.log(variance))
