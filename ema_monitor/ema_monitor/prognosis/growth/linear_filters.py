"""Kalman filters of growth that is linear in what is not known of it, beside the cells of a bank.

Each component has a number of filters, of a state whose first figure is the level. They are
measured as the cells are, with errors that last and occasional ones.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from copy import copy
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY, probabilities_below
from ema_monitor.prognosis.growth.measurement import REACH
from ema_monitor.prognosis.growth.near_healthy import near_healthy_update
from ema_monitor.prognosis.growth.settings import TrackerSettings

_RATE_WALK: Final = 0.01
"""Relative random walk of the rate [1/sqrt(h)]."""

RATE_SPREAD: Final = 0.15
"""Standard deviation of the logarithm of the mean rate to come, over that of now [-]."""


class LinearFilters(ABC):
    """Probability, mean and covariance of every filter, those of a component in a row.

    Parameters
    ----------
    prior
        Probabilities before any test, ``(7, k)``; with those of the cells of a component, and of
        its other filters, they sum to 1.
    grows
        Filters whose level grows, ``(k,)``.
    seen
        What a test measures, as weights of the figures of a state, ``(d,)``.
    settings
        Noise and probabilities.

    Attributes
    ----------
    prior, weight
        Probabilities before any test, and now, ``(7, k)``.
    grows
        Filters whose level grows, ``(k,)``.
    mean, covariance
        Of the states, ``(7, k, d)`` and ``(7, k, d, d)``.
    """

    def __init__(
        self,
        prior: NDArray[np.float64],
        grows: NDArray[np.bool_],
        seen: NDArray[np.float64],
        settings: TrackerSettings,
    ) -> None:
        self._settings = settings
        self.grows = grows
        self._seen = seen
        self.prior, self.weight = prior, prior.copy()
        self.mean = np.zeros((*prior.shape, seen.size))
        self.covariance = np.zeros((*prior.shape, seen.size, seen.size))
        self._before = self.mean, self.covariance
        self._step = np.zeros_like(self.covariance), np.zeros_like(self.covariance)

    def frozen(self) -> Self:
        """Return a copy that does not change with this one."""
        twin = copy(self)
        twin.weight, twin.mean = self.weight.copy(), self.mean.copy()
        twin.covariance = self.covariance.copy()
        return twin

    def state(self, name: str) -> dict[str, NDArray[Any]]:
        """Return all that is known, under keys that begin with a name, for ``restore``."""
        return {
            f"{name}_weight": self.weight,
            f"{name}_mean": self.mean,
            f"{name}_covariance": self.covariance,
        }

    def restore(self, name: str, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what ``state`` of filters of the same limits and settings returned.

        Raises
        ------
        ValueError, KeyError
            When it is none.
        """
        if (shape := state[f"{name}_covariance"].shape) != self.covariance.shape:
            raise ValueError(f"{name}_covariance has shape {shape}, not {self.covariance.shape}")
        self.weight, self.mean = state[f"{name}_weight"], state[f"{name}_mean"]
        self.covariance = state[f"{name}_covariance"]

    def moments(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and variance of what a test measures, by each filter, ``(7, k)`` each."""
        return self.mean @ self._seen, self.covariance @ self._seen @ self._seen

    @abstractmethod
    def rates(self) -> NDArray[np.float64]:
        """Return the growth of the level in each filter [1/h], ``(7, k)``."""

    @abstractmethod
    def restart(self, number: int, value: float, variance: float) -> None:
        """Start the level of a component anew, its growth unknown.

        Parameters
        ----------
        number, value, variance
            Of the component, its new signed distance from healthy, and its variance [-].
        """

    @abstractmethod
    def change_rate(self, number: int, rate: float, sigma: float) -> None:
        """Let a component that grows go on at another rate, of a standard deviation [1/h]."""

    def samples(
        self, number: NDArray[np.intp], of_it: NDArray[np.intp], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        """Return a sample of the state of some filters, each time it is named, ``(m, d)``.

        Parameters
        ----------
        number, of_it
            Numbers of component and filter, ``(m,)`` each.
        rng
            Random numbers.
        """
        k = self.weight.shape[1]
        pairs, which = np.unique(number * k + of_it, return_inverse=True)
        owner, one = np.divmod(pairs, k)
        values, vectors = np.linalg.eigh(self.covariance[owner, one])
        root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        normal = rng.standard_normal((number.size, self._seen.size))
        return self.mean[number, of_it] + np.einsum("mij,mj->mi", root[which], normal)

    def _growth_noise(
        self, squared_rate: NDArray[np.float64], hours: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the covariance of the noise of level and rate, ``(7, k, d, d)``; 0 of the others.

        Parameters
        ----------
        squared_rate
            Square of the rate that each filter has over the hours [1/h^2], ``(7, k)``.
        hours
            Hours of growth [h], in a form that broadcasts to ``(7, k)``.
        """
        walk = squared_rate * _RATE_WALK**2 * hours
        noise = np.zeros_like(self.covariance)
        noise[..., 0, 0] = squared_rate * self._settings.noise_hours * hours
        noise[..., 0, 0] += walk * hours**2 / 3.0
        noise[..., 0, 1] = noise[..., 1, 0] = walk * hours / 2.0
        noise[..., 1, 1] = walk
        return noise

    def _go_on(self, step: NDArray[np.float64], noise: NDArray[np.float64]) -> None:
        """Multiply the states by a matrix, ``(7, k, d, d)``, and add noise of a covariance."""
        self._before, self._step = (self.mean, self.covariance), (step, noise)
        self.mean = np.einsum("nkij,nkj->nki", step, self.mean)
        self.covariance = step @ self.covariance @ np.swapaxes(step, 2, 3) + noise

    def measure(
        self,
        plain: NDArray[np.intp],
        value: NDArray[np.float64],
        fresh: NDArray[np.float64],
        carried: NDArray[np.float64],
        value_before: NDArray[np.float64],
        log_likelihood: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Update the filters of some components by values with occasional errors.

        Parameters
        ----------
        plain
            Numbers of the components, ``(m,)``.
        value, fresh, carried, value_before
            As of ``measure_cells``.
        log_likelihood
            Of each filter, ``(7, k)``; written for those components.

        Returns
        -------
        numpy.ndarray
            Probabilities of a smaller value by each filter, ``(7, k)``; 0 of other components.
        """
        settings, c = self._settings, carried[plain, None]
        mean, covariance = (part[plain] for part in self._before)
        step, noise = (part[plain] for part in self._step)
        seen = self._seen @ step - c[..., None] * self._seen
        innovation = value[plain, None] - self.mean[plain] @ self._seen
        innovation = innovation - c * (value_before[plain, None] - mean @ self._seen)
        from_noise = self._seen @ noise
        spread = np.einsum("mkij,mkj->mki", covariance, seen)
        shared = np.einsum("mkij,mkj->mki", step, spread) + from_noise
        usual = np.einsum("mki,mki->mk", seen, spread) + from_noise @ self._seen
        usual = usual + fresh[plain, None]
        wide, rare = usual + settings.occasional_error**2, settings.occasional_probability
        squared = innovation**2
        log_usual = np.log1p(-rare) - 0.5 * (squared / usual + np.log(usual))
        log_wide = np.log(max(rare, LEAST_PROBABILITY)) - 0.5 * (squared / wide + np.log(wide))
        log_likelihood[plain] = log_p = np.logaddexp(log_usual, log_wide)
        share = np.exp(log_wide - log_p)
        gain = 1.0 / usual + share * (1.0 / wide - 1.0 / usual)
        self.mean[plain] += shared * (gain * innovation)[..., None]
        both = share * (1.0 - share) * (1.0 / usual - 1.0 / wide) ** 2 * squared
        outer = shared[..., None] * shared[..., None, :]
        self.covariance[plain] -= outer * (gain - both)[..., None, None]
        below = np.zeros_like(self.weight)
        own = np.empty(innovation.size)
        probabilities_below(innovation.ravel(), usual.ravel(), wide.ravel(), rare, own)
        below[plain] = own.reshape(innovation.shape)
        return below

    def measure_near(
        self,
        near: NDArray[np.intp],
        noise: NDArray[np.float64],
        two_sided: NDArray[np.bool_],
        log_likelihood: NDArray[np.float64],
    ) -> None:
        """Update the filters of components that were set to healthy.

        Parameters
        ----------
        near
            Numbers of the components, ``(m,)``.
        noise
            Variances of the errors, ``(7,)``.
        two_sided
            Whether each component may lie on either side of healthy, ``(7,)``.
        log_likelihood
            Of each filter, ``(7, k)``; written for those components.
        """
        if not near.size:
            return
        k = self.weight.shape[1]
        mean, variance = (part[near].ravel() for part in self.moments())
        was, before = mean.copy(), variance.copy()
        of_each = np.repeat(near, k)
        log_p = np.empty(mean.size)
        near_healthy_update(
            mean, variance, noise[of_each], REACH[of_each], two_sided[of_each], log_p
        )
        log_likelihood[near] = log_p.reshape(-1, k)
        gain = self.covariance[near] @ self._seen / before.reshape(-1, k)[..., None]
        self.mean[near] += gain * (mean - was).reshape(-1, k)[..., None]
        change = (variance - before).reshape(-1, k)[..., None, None]
        self.covariance[near] += gain[..., None] * gain[..., None, :] * change
