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
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY
from ema_monitor.prognosis.growth.linear_filters import LinearFilters
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


class Waves(LinearFilters):
    """Filters of waves: states are x, v and the parts of w, a test measures x + w.

    Parameters
    ----------
    limits
        Where life ends.
    settings
        Noise and probabilities; a component of known law has no wave.

    Attributes
    ----------
    omega
        Turn of the wave [rad/h], ``(k,)``.
    """

    def __init__(self, limits: HealthLimits, settings: TrackerSettings) -> None:
        self.omega = np.tile(2.0 * np.pi / PERIODS, _LIVES.size)
        grows = np.repeat(np.isfinite(_LIVES), PERIODS.size)
        share = np.where(grows, 0.5 / grows.sum(), 0.5 / (~grows).sum())
        has_wave = np.array([name not in settings.laws for name in COMPONENTS])
        prior = np.where(has_wave[:, None], PRIOR * share, 0.0)
        super().__init__(prior, grows, np.array([1.0, 0.0, 1.0, 0.0]), settings)
        limit = np.array([limits.of(name) for name in COMPONENTS])
        self._wave_variance = (AMPLITUDE * limit) ** 2
        self._rate_variance = (limit[:, None] / np.repeat(_LIVES, PERIODS.size)) ** 2
        for number in range(len(COMPONENTS)):
            self.restart(number, 0.0, 1.0)

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
