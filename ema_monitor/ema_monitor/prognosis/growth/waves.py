"""Filters for faults under a wave: what season, temperature or load add and take away again.

The state of each is level x, rate v, and a wave of known period and unknown amplitude and phase:
w turns by 2 pi hours / period and slowly becomes another. A test measures x + w. There is one
filter for each period of a grid, for a component that does not grow and for growth of some speed;
being linear and Gaussian each is a Kalman filter, with errors that last as those of the cells.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.filters import probabilities_below
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

_LIVES: Final = np.array([np.inf, 2500.0, 600.0])
"""Hours to the limit at one standard deviation of the rate [h]; infinite without growth."""

_RATE_WALK: Final = 0.01
"""Relative random walk of the rate [1/sqrt(h)]."""

_HIDDEN: Final = 1e-280


class Waves:
    """Probability, mean and covariance of every filter, those of a component in a row.

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
    mean, covariance
        Of x, v and the parts of w, ``(7, k, 4)`` and ``(7, k, 4, 4)``.
    grows
        Filters whose level grows, ``(k,)``.
    omega
        Turn of the wave [rad/h], ``(k,)``.
    """

    def __init__(self, limits: HealthLimits, settings: TrackerSettings) -> None:
        self._settings = settings
        self.omega = np.tile(2.0 * np.pi / PERIODS, _LIVES.size)
        self.grows = np.repeat(np.isfinite(_LIVES), PERIODS.size)
        n, k = len(COMPONENTS), self.omega.size
        share = np.where(self.grows, 0.5 / self.grows.sum(), 0.5 / (~self.grows).sum())
        has_wave = np.array([name not in settings.laws for name in COMPONENTS])
        self.prior = np.where(has_wave[:, None], PRIOR * share, 0.0)
        self.weight = self.prior.copy()
        limit = np.array([limits.of(name) for name in COMPONENTS])
        self._wave_variance = (AMPLITUDE * limit) ** 2
        self._rate_variance = (limit[:, None] / np.repeat(_LIVES, PERIODS.size)) ** 2
        self.mean = np.zeros((n, k, 4))
        self.covariance = np.zeros((n, k, 4, 4))
        self._before = self.mean, self.covariance
        self._step = np.zeros((n, k, 4, 4)), np.zeros((n, k, 4, 4))
        for number in range(n):
            self.restart(number, 0.0, 1.0)
        self._noise_hours = float(np.expm1(settings.process_noise**2))
        self._noise_hours *= settings.process_noise_hours

    def frozen(self) -> "Waves":
        """Return a copy that does not change with this one."""
        twin = Waves.__new__(Waves)
        twin.__dict__ = dict(self.__dict__)
        twin.weight, twin.mean = self.weight.copy(), self.mean.copy()
        twin.covariance = self.covariance.copy()
        return twin

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

    def moments(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and variance of x + w in each filter, ``(7, k)`` each."""
        p = self.covariance
        return (
            self.mean[..., 0] + self.mean[..., 2],
            p[..., 0, 0] + 2.0 * p[..., 0, 2] + p[..., 2, 2],
        )

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
        noise = np.zeros_like(self.covariance)
        rate = np.where(self.grows, self.mean[..., 1] ** 2, 0.0)
        walk = rate * _RATE_WALK**2 * hours
        noise[..., 0, 0] = rate * self._noise_hours * hours + walk * hours**2 / 3.0
        noise[..., 0, 1] = noise[..., 1, 0] = walk * hours / 2.0
        noise[..., 1, 1] = walk
        noise[..., 2, 2] = noise[..., 3, 3] = self._wave_variance[:, None] * (1.0 - kept**2)
        self._before, self._step = (self.mean, self.covariance), (step, noise)
        self.mean = np.einsum("nkij,nkj->nki", step, self.mean)
        self.covariance = step @ self.covariance @ np.swapaxes(step, 2, 3) + noise

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
            total = np.maximum(self.weight[:, at] + out / groups, _HIDDEN)
            share = out / groups / total
            gap = self.mean[:, :periods] - self.mean[:, at]
            arriving = self.covariance[:, :periods].copy()
            arriving[..., 1, 1] += self._rate_variance[:, at]
            mixed = share[..., None, None]
            self.covariance[:, at] += mixed * (arriving - self.covariance[:, at])
            self.covariance[:, at] += mixed * (1.0 - mixed) * gap[..., None] * gap[..., None, :]
            self.mean[:, at] += share[..., None] * gap
            self.weight[:, at] = total * (self.prior[:, at] > 0.0)

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
        seen = (step[..., 0, :] + step[..., 2, :]) - np.stack([c, 0.0 * c, c, 0.0 * c], axis=-1)
        innovation = value[plain, None] - self.mean[plain, :, 0] - self.mean[plain, :, 2]
        innovation = innovation - c * (value_before[plain, None] - mean[..., 0] - mean[..., 2])
        from_noise = noise[..., 0, :] + noise[..., 2, :]
        spread = np.einsum("mkij,mkj->mki", covariance, seen)
        shared = np.einsum("mkij,mkj->mki", step, spread) + from_noise
        usual = np.einsum("mki,mki->mk", seen, spread) + from_noise[..., 0] + from_noise[..., 2]
        usual = usual + fresh[plain, None]
        wide, rare = usual + settings.occasional_error**2, settings.occasional_probability
        squared = innovation**2
        log_usual = np.log1p(-rare) - 0.5 * (squared / usual + np.log(usual))
        log_wide = np.log(max(rare, _HIDDEN)) - 0.5 * (squared / wide + np.log(wide))
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
        k = self.omega.size
        mean, variance = (part[near].ravel() for part in self.moments())
        was, before = mean.copy(), variance.copy()
        of_each = np.repeat(near, k)
        log_p = np.empty(mean.size)
        near_healthy_update(
            mean, variance, noise[of_each], REACH[of_each], two_sided[of_each], log_p
        )
        log_likelihood[near] = log_p.reshape(-1, k)
        p = self.covariance[near]
        gain = (p[..., 0] + p[..., 2]) / before.reshape(-1, k)[..., None]
        self.mean[near] += gain * (mean - was).reshape(-1, k)[..., None]
        change = (variance - before).reshape(-1, k)[..., None, None]
        self.covariance[near] += gain[..., None] * gain[..., None, :] * change
