"""Size and correlation of the errors of a unit's estimates, learnt from its tests.

The errors of an estimate are those of its covariance times a factor, and follow an AR(1) process
from test to test. Factor and correlation are on a grid: each pair has a Kalman filter of its own
for each component, of level and a rate that wanders, and its probability is the likelihood of all
tests by them. These filters assume no law, so that a wrong one is not taken for lasting errors.
"""

from typing import Final

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS
from ema_monitor.prognosis.growth.filters import Observation, growth_of_rate, measured
from ema_monitor.prognosis.growth.kept import Kept
from ema_monitor.prognosis.growth.settings import TrackerSettings

CORRELATIONS: Final = np.array([0.0, 0.25, 0.5, 0.75])
"""Correlations of the errors of successive tests on the grid [-]."""

FACTORS: Final = np.array([0.5, 0.7, 1.0, 1.4, 2.0])
"""Factors of the standard deviations of the estimates on the grid [-]."""

_FACTOR_SIGMA: Final = 0.35
_CORRELATED: Final = np.array([0.5, 0.5 / 3.0, 0.5 / 3.0, 0.5 / 3.0])
_LOG_PRIOR: Final = np.log(_CORRELATED)[:, None] - 0.5 * (np.log(FACTORS) / _FACTOR_SIGMA) ** 2

_RATE_SIGMA: Final = 1e-3
"""Standard deviation of a rate before any test [1/h]."""

_RATE_WALK: Final = 0.02
"""Relative random walk of a rate [1/sqrt(h)]."""

_LEAST_RATE: Final = 3e-5
"""Rate below which the walk is that of this one [1/h]."""

_SEEN: Final = np.array([1.0, 0.0])


class EstimateErrors(Kept):
    """Probabilities of size and correlation of the errors of a unit's estimates.

    Attributes
    ----------
    value, noise, used
        Signed distances from healthy of the test before, variances of their errors, and components
        whose levels it measured, ``(7,)`` each.
    log_probability
        Logarithms of the probabilities of correlations and factors, up to a constant, ``(4, 5)``.
    mean, covariance
        Level and rate of each component by each pair, ``(7, 4, 5, 2)`` and ``(7, 4, 5, 2, 2)``.
    hours
        Hours since each component was last measured [h], ``(7,)``; infinite when it is to start.
    """

    kept = ("value", "noise", "used", "log_probability", "mean", "covariance", "hours")

    def __init__(self, settings: TrackerSettings) -> None:
        self._settings = settings
        self.log_probability = _LOG_PRIOR.copy()
        n, shape = len(COMPONENTS), (CORRELATIONS.size, FACTORS.size)
        self.value, self.noise, self.used = np.zeros(n), np.ones(n), np.zeros(n, dtype=bool)
        self.mean = np.zeros((n, *shape, 2))
        self.covariance = np.zeros((n, *shape, 2, 2))
        self.hours = np.full(n, np.inf)

    @property
    def probability(self) -> Array:
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

    def noise_of(self, noise: Array) -> Array:
        """Return the variances of errors, learnt from those of the estimates, ``(7,)``."""
        # Scatter shows no error that stays: an estimate is never better than it says.
        return max(self.factor, 1.0) ** 2 * noise

    def advance(self, hours: Array) -> None:
        """Count the hours of growth since the tests, ``(7,)`` [h]."""
        self.hours = self.hours + hours

    def skip(self) -> None:
        """Leave a test unused: the errors of the one before no longer last into the next."""
        self.used = np.zeros_like(self.used)

    def restart(self, number: int) -> None:
        """Begin anew with a component at its next test: its level has changed."""
        self.hours[number], self.used[number] = np.inf, False

    def observed(self, value: Array, noise: Array, plain: Flags, near: Flags) -> Observation:
        """Learn from a test, and return what it shows of each component, ``(7,)`` each.

        Parameters
        ----------
        value, noise
            Signed distances from healthy and variances of their errors.
        plain, near
            Components that the test measures, and those that it finds near healthy.
        """
        self.learn(value, noise, plain)
        correlation, variance = self.correlation, self.noise_of(noise)
        carried = np.where(self.used, correlation * np.sqrt(noise / self.noise), 0.0)
        fresh = np.where(self.used, 1.0 - correlation**2, 1.0) * variance
        test = Observation(value, noise, plain, near, carried, self.value, fresh)
        self.value, self.noise, self.used = value, noise, plain
        return test

    def learn(self, value: Array, noise: Array, used: Flags) -> None:
        """Learn from the components that a test measures; arguments as of ``observed``."""
        begins = np.flatnonzero(used & ~np.isfinite(self.hours))
        self.mean[begins] = 0.0
        self.mean[begins, ..., 0] = value[begins, None, None]
        self.covariance[begins] = 0.0
        self.covariance[begins, ..., 0, 0] = noise[begins, None, None] * FACTORS**2
        self.covariance[begins, ..., 1, 1] = _RATE_SIGMA**2
        at = np.flatnonzero(used & np.isfinite(self.hours))
        if at.size:
            follows, correlation = self.used[at, None, None], CORRELATIONS[:, None]
            carried = correlation * np.sqrt(noise[at] / self.noise[at])[:, None, None] * follows
            fresh = np.where(follows, 1.0 - correlation**2, 1.0) * FACTORS**2
            before, rate = (self.mean[at], self.covariance[at]), self.mean[at][..., 1]
            walk = _RATE_WALK**2 * (rate**2 + _LEAST_RATE**2)
            by = growth_of_rate(rate, self.hours[at, None, None], self._settings.noise_hours, walk)
            self.mean[at], self.covariance[at], told = measured(
                before,
                by,
                _SEEN,
                value[at, None, None],
                self.value[at, None, None],
                carried,
                fresh * noise[at, None, None],
                self._settings,
            )
            self.log_probability = self.log_probability + np.sum(told.log_likelihood, axis=0)
            self.log_probability -= self.log_probability.max()
        self.hours = np.where(used, 0.0, self.hours)
