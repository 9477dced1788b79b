"""Filters for faults under a wave: what season, temperature or load add and take away again.

The state of each is level x, rate v, and a wave of known period and unknown amplitude and phase:
w turns by 2 pi hours / period and slowly becomes another. A test measures x + w. There is one
filter for each period of a grid, for a component that does not grow and for growth of some speed;
being linear and Gaussian each is a Kalman filter, with errors that last as those of the cells.
"""

from collections.abc import Mapping
from copy import copy
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY, probabilities_below
from ema_monitor.prognosis.growth.measurement import REACH
from ema_monitor.prognosis.growth.near_healthy import near_healthy_update
from ema_monitor.prognosis.growth.settings import TrackerSettings

PERIODS: Final = np.asarray(200.0 * 1.15 ** np.arange(13), dtype=np.float64)
"""Hours of a wave on the grid [h]."""

AMPLITUDE: Final = 0.025
"""Standard deviation of each of the two parts of a wave, as a share of the limit [-]."""

PRIOR: Final = 0.1
"""Probability of a wave in a component of unknown law [-]."""

LASTING: Final = 20.0
"""Periods within which a wave forgets its amplitude and phase."""

RATE_SPREAD: Final = 0.15
"""Standard deviation of the logarithm of the mean rate to come, over that of now [-]."""

_RATE_WALK: Final = 0.01
"""Relative random walk of the rate [1/sqrt(h)]."""

_LIVES: Final = np.array([np.inf, 2500.0, 600.0])
"""Hours to the limit at one standard deviation of the rate [h]; infinite without growth."""


class Waves:
    """Filters of waves: states are x, v and the parts of w, a test measures x + w.

    They are measured as the cells are, with errors that last and occasional ones.

    Parameters
    ----------
    limits
        Where life ends.
    settings
        Noise and probabilities; a component of known law has no wave.

    Attributes
    ----------
    prior, weight
        Probabilities before any test, and now, ``(7, k)``; with those of the cells of a component
        they sum to 1.
    grows
        Filters whose level grows, ``(k,)``.
    mean, covariance
        Of the states, ``(7, k, 4)`` and ``(7, k, 4, 4)``.
    omega
        Turn of the wave [rad/h], ``(k,)``.
    """

    def __init__(self, limits: HealthLimits, settings: TrackerSettings) -> None:
        self.omega = np.tile(2.0 * np.pi / PERIODS, _LIVES.size)
        grows = np.repeat(np.isfinite(_LIVES), PERIODS.size)
        share = np.where(grows, 0.5 / grows.sum(), 0.5 / (~grows).sum())
        has_wave = np.array([name not in settings.laws for name in COMPONENTS])
        prior = np.where(has_wave[:, None], PRIOR * share, 0.0)
        self._settings = settings
        self.grows = grows
        self._seen = np.array([1.0, 0.0, 1.0, 0.0])
        self.prior, self.weight = prior, prior.copy()
        self.mean = np.zeros((*prior.shape, self._seen.size))
        self.covariance = np.zeros((*self.mean.shape, self._seen.size))
        self._before = self.mean, self.covariance
        self._step = np.zeros_like(self.covariance), np.zeros_like(self.covariance)
        limit = np.array([limits.of(name) for name in COMPONENTS])
        self._wave_variance = (AMPLITUDE * limit) ** 2
        self._rate_variance = (limit[:, None] / np.repeat(_LIVES, PERIODS.size)) ** 2
        for number in range(len(COMPONENTS)):
            self.restart(number, 0.0, 1.0)

    def frozen(self) -> "Waves":
        """Return a copy that does not change with this one."""
        twin = copy(self)
        twin.weight, twin.mean = self.weight.copy(), self.mean.copy()
        twin.covariance = self.covariance.copy()
        return twin

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all that is known, for ``restore``."""
        return {
            "wave_weight": self.weight,
            "wave_mean": self.mean,
            "wave_covariance": self.covariance,
        }

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what ``state`` of filters of the same limits and settings returned.

        Raises
        ------
        ValueError, KeyError
            When it is none.
        """
        if (shape := state["wave_covariance"].shape) != self.covariance.shape:
            raise ValueError(f"wave_covariance has shape {shape}, not {self.covariance.shape}")
        self.weight, self.mean = state["wave_weight"], state["wave_mean"]
        self.covariance = state["wave_covariance"]

    def moments(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and variance of what a test measures, by each filter, ``(7, k)`` each."""
        return self.mean @ self._seen, self.covariance @ self._seen @ self._seen

    def restart(self, number: int, value: float, variance: float) -> None:
        """Start the level of a component anew, its wave and rate unknown.

        Parameters
        ----------
        number, value, variance
            Of the component, its new signed distance from healthy, and its variance [-].
        """
        wave = self._wave_variance[number]
        self.mean[number] = [value, 0.0, 0.0, 0.0]
        one = np.zeros_like(self.covariance[number])
        # The level is what the wave leaves of the value.
        one[:, 0, 0] = variance + wave
        one[:, 0, 2] = one[:, 2, 0] = -wave
        one[:, 1, 1] = self._rate_variance[number]
        one[:, 2, 2] = one[:, 3, 3] = wave
        self.covariance[number] = one

    def change_rate(self, number: int, rate: float, sigma: float) -> None:
        """Let a component that grows go on at another rate, of a standard deviation [1/h]."""
        mean, covariance = self.mean.copy(), self.covariance.copy()
        mean[number, self.grows, 1] = rate
        covariance[number, self.grows, 1, :] = covariance[number, self.grows, :, 1] = 0.0
        covariance[number, self.grows, 1, 1] = sigma**2
        self.mean, self.covariance = mean, covariance

    def rates(self) -> NDArray[np.float64]:
        """Return the growth of each filter, without its wave [1/h], ``(7, k)``."""
        return np.where(self.grows, self.mean[..., 1], 0.0)

    def advance(self, hours: NDArray[np.float64]) -> None:
        """Let the filters of each component go on over hours of its own, ``(7,)`` [h]."""
        self._begin()
        hours = hours[:, None]
        turn = hours * self.omega
        kept = np.exp(-turn / (2.0 * np.pi * LASTING))
        step = np.zeros_like(self.covariance)
        step[..., 0, 0] = step[..., 1, 1] = 1.0
        step[..., 0, 1] = hours
        step[..., 2, 2] = step[..., 3, 3] = kept * np.cos(turn)
        step[..., 2, 3] = kept * np.sin(turn)
        step[..., 3, 2] = -step[..., 2, 3]
        noise = self._growth_noise(np.where(self.grows, self.mean[..., 1] ** 2, 0.0), hours)
        noise[..., 2, 2] = noise[..., 3, 3] = self._wave_variance[:, None] * (1.0 - kept**2)
        self._go_on(step, noise)

    def _begin(self) -> None:
        """Let growth begin in filters without, with the probability of the settings."""
        part = self._settings.onset_probability
        periods = PERIODS.size
        still = self.weight[:, :periods]
        out = part * still
        self.weight[:, :periods] = still - out
        groups = _LIVES.size - 1
        for group in range(1, groups + 1):
            at = slice(group * periods, (group + 1) * periods)
            total = np.maximum(self.weight[:, at] + out / groups, LEAST_PROBABILITY)
            share = out / groups / total
            gap = self.mean[:, :periods] - self.mean[:, at]
            arriving = self.covariance[:, :periods].copy()
            arriving[..., 1, 1] += self._rate_variance[:, at]
            mixed = share[..., None, None]
            self.covariance[:, at] += mixed * (arriving - self.covariance[:, at])
            self.covariance[:, at] += mixed * (1.0 - mixed) * gap[..., None] * gap[..., None, :]
            self.mean[:, at] += share[..., None] * gap
            self.weight[:, at] = total * (self.prior[:, at] > 0.0)

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
