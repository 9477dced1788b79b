"""Size and correlation of the errors of a unit's estimates, learnt from its tests.

The errors of an estimate are those of its covariance times a factor, and follow an AR(1) process
from test to test. Factor and correlation are on a grid, whose probabilities are those of the
innovations of all components: how far a value is from what growth predicts, and whether it is off
to the same side as the one before.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS

CORRELATIONS: Final = np.array([0.0, 0.2, 0.4, 0.6, 0.8])
"""Correlations of the errors of successive tests on the grid [-]."""

FACTORS: Final = np.array([0.5, 0.7, 1.0, 1.4, 2.0])
"""Factors of the standard deviations of the estimates on the grid [-]."""

_FACTOR_SIGMA: Final = 0.35
_UNCORRELATED: Final = 0.5


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
    """Probabilities of size and correlation of the errors of a unit's estimates."""

    def __init__(self) -> None:
        self.log_probability = _log_prior()

    def frozen(self) -> "EstimateErrors":
        """Return a copy that does not change with this one."""
        twin = EstimateErrors()
        twin.log_probability = self.log_probability.copy()
        return twin

    @property
    def probability(self) -> NDArray[np.float64]:
        """Probabilities of correlations and factors, ``(5, 5)``."""
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

    def learn(
        self,
        now: tuple[NDArray[np.float64], NDArray[np.float64]],
        before: tuple[NDArray[np.float64], NDArray[np.float64]],
        test: tuple[NDArray[np.float64], NDArray[np.float64]],
        last: LastTest,
        used: NDArray[np.bool_],
        occasional: tuple[float, float],
    ) -> None:
        """Learn from a test.

        Parameters
        ----------
        now, before
            Mean and variance of each component's level, predicted for this test, and known after
            the one before, ``(7,)`` each.
        test
            Values and variances of their errors, without the factor, ``(7,)`` each.
        last
            The test before.
        used
            Components that both tests measured, ``(7,)``.
        occasional
            Standard deviation and probability of an occasional error [-].
        """
        if not used.any():
            return
        (mean, variance), (mean_0, variance_0) = (
            (one[0][used], one[1][used]) for one in (now, before)
        )
        (value, noise), large = (one[used] for one in test), occasional[0] ** 2
        c = CORRELATIONS[:, None, None] * np.sqrt(noise / last.noise[used])
        innovation = value - mean - c * (last.value[used] - mean_0)
        fresh = (1.0 - CORRELATIONS[:, None, None] ** 2) * FACTORS[:, None] ** 2 * noise
        usual = variance - 2.0 * c * variance_0 + c**2 * variance_0
        usual = np.maximum(usual, 0.0) + fresh
        log_p = np.logaddexp(
            np.log1p(-occasional[1]) + _log_normal(innovation, usual),
            np.log(max(occasional[1], 1e-280)) + _log_normal(innovation, usual + large),
        )
        self.log_probability = self.log_probability + np.sum(log_p, axis=2)
        self.log_probability -= self.log_probability.max()


def _log_normal(away: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    return -0.5 * (away**2 / variance + np.log(variance))
