# SPDX-License-Identifier: Apache-2.0
"""Scatter of healthy records within a day and between days, and prediction of a new record.

A figure of a record is modelled as ``x = mu + beta z + day + record + error``: normal effects with
unknown standard deviations between days and between records, and an error of known variance. The
standard deviations have log-normal priors, so that a few identical records do not imply zero
scatter; they are integrated out on a grid. The prediction for a new record is a mixture of normal
distributions (Gelman et al., Bayesian Data Analysis, chapter 5: hierarchical models).
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array

NODES: Final = 7
"""Number of grid points for each of the two standard deviations."""

SPREAD: Final = 0.8
"""Prior standard deviation of the logarithm of a standard deviation [-]."""

_REACH: Final = 2.5
_FARTHEST: Final = 8.0
_PRECISION: Final = 1e-6
_MOST_STEPS: Final = 60
_NEGLIGIBLE: Final = 1e-6
_SLOPE: Final = 30.0
_ROOT_2: Final = math.sqrt(2.0)
_TINY: Final = 1e-300


class Prediction(NamedTuple):
    """Predictive distribution of a figure: a mixture of ``m`` normal distributions.

    ``likelihoods`` are the weights without the prior of the scatter; all fields are ``(m,)``.
    """

    weights: Array
    means: Array
    variances: Array
    likelihoods: Array

    @property
    def mean(self) -> float:
        """Expected value."""
        return float(self.weights @ self.means)

    @property
    def sigma(self) -> float:
        """Standard deviation."""
        spread = self.variances + (self.means - self.mean) ** 2
        return float(np.sqrt(self.weights @ spread))

    def below(self, x: float) -> float:
        """Return the probability of a value below ``x``."""
        return float(self.weights @ _normal((x - self.means) / np.sqrt(self.variances)))

    def _density(self, x: float) -> float:
        z2 = (x - self.means) ** 2 / self.variances
        return float(self.weights @ (np.exp(-0.5 * z2) / np.sqrt(2.0 * np.pi * self.variances)))

    def probability(self, x: float) -> float:
        """Return the two-sided probability of a value at least as extreme as ``x``."""
        z = (x - self.means) / np.sqrt(self.variances)
        lower, upper = float(self.weights @ _normal(z)), float(self.weights @ _normal(-z))
        return min(1.0, 2.0 * min(lower, upper))

    def quantile(self, share: float) -> float:
        """Return the quantile at a cumulative probability ``share``."""
        reach = _FARTHEST * np.sqrt(self.variances)
        low, high = float(np.min(self.means - reach)), float(np.max(self.means + reach))
        x = self.mean
        tolerance = _PRECISION * (high - low)
        for _ in range(_MOST_STEPS):
            # Newton's method, with bisection for steps that leave the bracket.
            excess = self.below(x) - share
            low, high = (low, x) if excess > 0.0 else (x, high)
            step = -excess / max(self._density(x), _TINY)
            x = x + step if low < x + step < high else 0.5 * (low + high)
            if abs(step) < tolerance or high - low < tolerance:
                break
        return x

    def smallest_change(self, significance: float, power: float) -> float:
        """Return the smallest increase that a two-sided test detects with a given probability.

        The detection threshold is a quantile of the prediction with the prior of the scatter. The
        scatter of the increased value is predicted from the unit's records alone.

        Parameters
        ----------
        significance
            Probability that the test detects a change in a healthy record [-].
        power
            Probability that the test detects the increase [-].
        """
        limit = self.quantile(1.0 - 0.5 * significance)
        return limit - self._without_prior.quantile(1.0 - power)

    def interval(self, shares: tuple[float, float]) -> tuple[float, float]:
        """Return the quantiles at two probabilities, without the prior of the scatter."""
        low, high = map(self._without_prior.quantile, shares)
        return low, high

    @property
    def _without_prior(self) -> "Prediction":
        """Prediction from the scatter of the unit's records alone."""
        return self._replace(weights=self.likelihoods)


class Scatter:
    """Hierarchical model of one figure, fitted to healthy records.

    Parameters
    ----------
    values, variances
        Value of the figure in each record, and variance of its error, ``(n,)`` each.
    days
        Day of each record, ``(n,)``.
    between_records, between_days
        Prior medians of the standard deviations between records of one day and between days, in the
        unit of the figure.
    covariates
        Conditions on which the figure depends, ``(n, k)``, centred and scaled to about 1.
    """

    def __init__(
        self,
        values: Array,
        variances: Array,
        days: Sequence[int],
        between_records: float,
        between_days: float,
        covariates: Array | None = None,
    ) -> None:
        nodes = np.linspace(-_REACH, _REACH, NODES)
        prior = np.exp(-0.5 * nodes**2)
        record, day = np.meshgrid(
            between_records * np.exp(SPREAD * nodes), between_days * np.exp(SPREAD * nodes)
        )
        self._record, self._day = (record**2).ravel(), (day**2).ravel()
        log_prior = np.log(np.outer(prior, prior)).ravel()
        n = len(values)
        design = np.ones((n, 1))
        if covariates is not None and covariates.size:
            design = np.column_stack([design, covariates])
        p = design.shape[1]
        scale = max(between_days, between_records)
        centre = float(np.mean(values))
        # Sums over the records of a day, weighted by their precision, per grid point: (g, ...).
        precision = 1.0 / (variances[None, :] + self._record[:, None])
        target = values - centre
        normal = np.zeros((len(self._record), p, p))
        moment = np.zeros((len(self._record), p))
        square = np.zeros(len(self._record))
        log_det = -np.sum(np.log(precision), axis=1)
        self._days: dict[int, tuple[Array, Array, Array]] = {}
        for number in sorted(set(days)):
            chosen = np.asarray(days) == number
            w, x, y = precision[:, chosen], design[chosen], target[chosen]
            total = w.sum(axis=1)
            shrink = self._day / (1.0 + self._day * total)
            wx, wy = w @ x, w @ y
            normal += np.einsum("gi,ij,ik->gjk", w, x, x)
            normal -= shrink[:, None, None] * wx[:, :, None] * wx[:, None, :]
            moment += np.einsum("gi,ij,i->gj", w, x, y) - shrink[:, None] * wx * wy[:, None]
            square += w @ y**2 - shrink * wy**2
            log_det += np.log1p(self._day * total)
            self._days[number] = total, wx, wy
        ridge = np.zeros(p)
        ridge[1:] = (_SLOPE * scale) ** -2.0
        normal += np.diag(ridge)
        self._covariance = np.linalg.inv(normal)
        self._beta = np.einsum("gjk,gk->gj", self._covariance, moment)
        fit = square - np.einsum("gj,gj->g", moment, self._beta)
        log_likelihood = -0.5 * (log_det + fit + np.linalg.slogdet(normal)[1])
        self._weights = _shares(log_prior + log_likelihood)
        self._likelihoods = _shares(log_likelihood)
        self._centre = centre

    def predict(
        self, variance: float, day: int | None = None, covariates: Array | None = None
    ) -> Prediction:
        """Return the prediction for a new record.

        Parameters
        ----------
        variance
            Variance of the error of the figure of the new record.
        day
            Day of the new record; None for a day without healthy records.
        covariates
            Conditions of the new record, ``(k,)``; None for mean conditions. They are ignored if
            the model has no covariates.
        """
        row = np.ones(self._beta.shape[1])
        if covariates is not None and len(row) > 1:
            row[1:] = covariates
        if day in self._days:
            total, wx, wy = self._days[day]
            shrink = self._day / (1.0 + self._day * total)
            effect = shrink * (wy - np.einsum("gj,gj->g", wx, self._beta))
            sensitivity = row[None, :] - shrink[:, None] * wx
            spread = shrink
        else:
            effect = np.zeros(len(self._day))
            sensitivity = np.broadcast_to(row, self._beta.shape)
            spread = self._day
        means = self._centre + self._beta @ row + effect
        mean_variances = np.einsum("gj,gjk,gk->g", sensitivity, self._covariance, sensitivity)
        variances = mean_variances + spread + self._record + variance + _TINY
        kept = np.maximum(self._weights, self._likelihoods) > _NEGLIGIBLE
        weights, likelihoods = (
            shares[kept] / np.sum(shares[kept]) for shares in (self._weights, self._likelihoods)
        )
        return Prediction(weights, means[kept], variances[kept], likelihoods)

    @property
    def variance(self) -> float:
        """Expected variance between records of different days."""
        return float(self._weights @ (self._record + self._day))


def _shares(logarithms: Array) -> Array:
    """Return normalised weights from their logarithms."""
    weights = np.exp(logarithms - np.max(logarithms))
    return np.asarray(weights / np.sum(weights), dtype=np.float64)


def _normal(z: Array) -> Array:
    """Return the cumulative normal distribution, accurate in the lower tail."""
    return 0.5 * np.array([*map(math.erfc, (z / -_ROOT_2).tolist())])
