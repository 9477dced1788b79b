# SPDX-License-Identifier: Apache-2.0
"""Kalman filters for faults with a superimposed wave, a periodic disturbance (P6c).

Waves represent seasonal, temperature or load effects. The state has the level x, the rate v, and
the wave w, which has a known period and slowly varying amplitude and phase. A test measures x + w.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core._jit import kernel
from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY, corrected, near_healthy_update
from ema_monitor.prognosis.growth.kept import Kept
from ema_monitor.prognosis.growth.measurement import REACH, Measurement
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings

PERIODS: Final = np.asarray(200.0 * 1.15 ** np.arange(13), dtype=np.float64)
"""Grid of wave periods [h]."""

AMPLITUDE: Final = 0.025
"""Prior standard deviation of each quadrature component of a wave, relative to the limit [-]."""

LASTING: Final = 20.0
"""Correlation time of the amplitude and phase of a wave [periods]."""

RATE_SPREAD: Final = 0.15
"""Standard deviation of the log-ratio of the future mean rate to the current rate [-]."""

_RATE_WALK: Final = 0.01
"""Relative random walk of the rate [1/sqrt(h)]."""

_LIVES: Final = np.array([np.inf, 2500.0, 600.0])
"""Hours to the limit at one prior standard deviation of the rate [h]; infinite means no growth."""

_SEEN: Final = np.array([1.0, 0.0, 1.0, 0.0])
_LEAST_RATE: Final = 1e-6
"""Smallest rate that counts as growth, relative to the limit [1/h]."""

_STEPS_A_PERIOD: Final = 20


class Waves(Kept):
    """Kalman filters of all wave periods, with states x, v and the quadrature components of w.

    Attributes
    ----------
    prior
        Prior probabilities, ``(7, k)``; they sum to the argument ``prior`` for each component, or
        to 0 if its law is known.
    grows
        Whether each filter models growth, ``(k,)``.
    mean, covariance
        Mean and covariance of the states, ``(7, k, 4)`` and ``(7, k, 4, 4)``.
    omega
        Angular frequency of each filter's wave, ``(k,)`` [rad/h].
    """

    kept = ("mean", "covariance")

    def __init__(
        self, limits: HealthLimits, settings: TrackerSettings, two_sided: Flags, prior: float
    ) -> None:
        self._settings, self.two_sided = settings, two_sided
        self.omega = np.tile(2.0 * np.pi / PERIODS, _LIVES.size)
        self.grows = np.repeat(np.isfinite(_LIVES), PERIODS.size)
        share = np.where(self.grows, 0.5 / self.grows.sum(), 0.5 / (~self.grows).sum())
        has_wave = np.array([name not in settings.laws for name in COMPONENTS])
        self.prior = np.where(has_wave[:, None], prior * share, 0.0)
        self.mean = np.zeros((*self.prior.shape, 4))
        self.covariance = np.zeros((*self.mean.shape, 4))
        self._limit = np.array([limits.of(name) for name in COMPONENTS])
        self._wave_variance = (AMPLITUDE * self._limit) ** 2
        self._rate_variance = (self._limit[:, None] / np.repeat(_LIVES, PERIODS.size)) ** 2
        for number in range(len(COMPONENTS)):
            self.restart(number, 0.0, 1.0)

    def moments(self) -> tuple[Array, Array]:
        """Return predicted mean and variance of a measurement by filter, ``(7, k)`` each."""
        return self.mean @ _SEEN, self.covariance @ _SEEN @ _SEEN

    def restart(self, number: int, value: float, variance: float) -> None:
        """Reset a component to a signed distance from healthy, with wave and rate unknown."""
        wave = self._wave_variance[number]
        self.mean[number] = [value, 0.0, 0.0, 0.0]
        covariance = np.zeros_like(self.covariance[number])
        # The level is the measured value minus the unknown wave.
        covariance[:, 0, 0] = variance + wave
        covariance[:, 0, 2] = covariance[:, 2, 0] = -wave
        covariance[:, 1, 1] = self._rate_variance[number]
        covariance[:, 2, 2] = covariance[:, 3, 3] = wave
        self.covariance[number] = covariance

    def rates(self) -> Array:
        """Return the growth rate of each filter, excluding the wave, ``(7, k)`` [1/h].

        The rate is 0 for filters without growth.
        """
        return np.where(self.grows, self.mean[..., 1], 0.0)

    def advance(self, weight: Array, hours: Array) -> None:
        """Propagate all filters by the hours of each component, ``(7,)`` [h]; growth may begin.

        ``weight``, the probability of each filter, ``(7, k)``, is updated in place.
        """
        self._begin(weight)
        hours = hours[:, None]
        rate, turn = self.rates(), hours * self.omega
        kept = np.exp(-turn / (2.0 * np.pi * LASTING))
        step, noise = np.zeros((2, *self.covariance.shape))
        step[..., 0, 0] = step[..., 1, 1] = 1.0
        step[..., 0, 1] = hours
        walked = (_RATE_WALK * rate) ** 2 * hours
        noise[..., 0, 0] = rate**2 * self._settings.noise_hours * hours + walked * hours**2 / 3.0
        noise[..., 0, 1] = noise[..., 1, 0] = walked * hours / 2.0
        noise[..., 1, 1] = walked
        step[..., 2, 2] = step[..., 3, 3] = kept * np.cos(turn)
        step[..., 2, 3] = kept * np.sin(turn)
        step[..., 3, 2] = -step[..., 2, 3]
        noise[..., 2, 2] = noise[..., 3, 3] = self._wave_variance[:, None] * (1.0 - kept**2)
        self.mean = np.einsum("...ij,...j->...i", step, self.mean)
        self.covariance = step @ self.covariance @ np.swapaxes(step, -1, -2) + noise

    def _begin(self, weight: Array) -> None:
        """Move the onset probability from filters without growth to filters with growth."""
        n, groups = PERIODS.size, _LIVES.size - 1
        out = self._settings.onset_probability * weight[:, :n]
        weight[:, :n] -= out
        for start in range(n, weight.shape[1], n):
            at = slice(start, start + n)
            total = np.maximum(weight[:, at] + out / groups, LEAST_PROBABILITY)
            share = (out / groups / total)[..., None]
            mixed = share[..., None]
            gap = self.mean[:, :n] - self.mean[:, at]
            arriving = self.covariance[:, :n].copy()
            arriving[..., 1, 1] += self._rate_variance[:, at]
            self.covariance[:, at] += mixed * (arriving - self.covariance[:, at])
            self.covariance[:, at] += mixed * (1.0 - mixed) * gap[..., None] * gap[..., None, :]
            self.mean[:, at] += share * gap
            weight[:, at] = total * (self.prior[:, at] > 0.0)

    def measure(self, test: Measurement, plain: Flags, near: Flags) -> tuple[Array, Array]:
        """Update all filters with a test.

        Parameters
        ----------
        test
            The test.
        plain, near
            Components with a measured value, and components that the estimate set to healthy,
            ``(7,)``.

        Returns
        -------
        tuple of numpy.ndarray
            Log-likelihood of each filter, and predicted probability of a value below the measured
            value, ``(7, k)`` each. The log-likelihood is 0 for components that are neither in
            ``plain`` nor in ``near``; the probability is 0 for components that are not in
            ``plain``.
        """
        log_likelihood, below = np.zeros_like(self.prior), np.zeros_like(self.prior)
        at, (mean, variance) = plain, self.moments()
        innovation = test.value[at, None] - mean[at]
        update = corrected(innovation, variance[at] + test.noise[at, None], self._settings)
        shared = self.covariance[at] @ _SEEN
        self.mean[at] += shared * (update.gain * innovation)[..., None]
        outer = shared[..., None] * shared[..., None, :]
        self.covariance[at] -= outer * update.shrinking[..., None, None]
        log_likelihood[at], below[at] = update.log_likelihood, update.below
        at = np.flatnonzero(near)
        k, (was, before) = np.repeat(at, self.omega.size), (mean[at], variance[at])
        level, left, log_p = was.ravel().copy(), before.ravel().copy(), np.empty(k.size)
        near_healthy_update(level, left, test.noise[k], REACH[k], self.two_sided[k], log_p)
        log_likelihood[at] = log_p.reshape(was.shape)
        gain = self.covariance[at] @ _SEEN / before[..., None]
        self.mean[at] += gain * (level.reshape(was.shape) - was)[..., None]
        change = (left.reshape(was.shape) - before)[..., None, None]
        self.covariance[at] += gain[..., None] * gain[..., None, :] * change
        return log_likelihood, below

    def drawn(
        self, number: NDArray[np.intp], filters: NDArray[np.intp], rng: np.random.Generator
    ) -> "WaveDraw":
        """Return a random sample for each pair of component and filter index, ``(m,)`` each."""
        pairs, which = np.unique(number * self.omega.size + filters, return_inverse=True)
        covariance = self.covariance.reshape(-1, 4, 4)[pairs]
        values, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        normal = rng.standard_normal((number.size, 4))
        state = self.mean[number, filters] + np.einsum("mij,mj->mi", root[which], normal)
        spread = np.exp(RATE_SPREAD * rng.standard_normal(number.size))
        state[:, 1] *= np.where(self.grows[filters], spread, 0.0)
        # Only two-sided components can grow in the negative direction.
        side = np.where(self.two_sided[number] & (state[:, 1] < 0.0), -1.0, 1.0)
        return WaveDraw(state, self.omega[filters], side / self._limit[number])


@dataclass(frozen=True, eq=False)
class WaveDraw:
    """Samples of faults with a wave."""

    state: Array
    """Signed level, rate [1/h] and the two wave components, ``(m, 4)``."""
    omega: Array
    """Angular frequency of the wave, ``(m,)`` [rad/h]."""
    scale: Array
    """Reciprocal of the limit, negative for growth in the negative direction, ``(m,)``."""

    def lives(self) -> Array:
        """Return the time until each sample first reaches its limit, ``(m,)`` [h].

        The time is infinite without growth.
        """
        return _first_passages(self.state * self.scale[:, None], self.omega)

    def values(self, hours: Array) -> Array:
        """Return the signed distances from healthy after ``hours``, ``(k, m)``."""
        x, rate, c, s = self.state.T
        turn = hours * self.omega
        return x + rate * hours + c * np.cos(turn) + s * np.sin(turn)


@kernel()
def _first_passages(state: Array, omega: Array) -> Array:
    """Return the time until the sum of level and wave first reaches 1, ``(m,)`` [h].

    The time is infinite if the sum is below 1 now and the rate is below ``_LEAST_RATE``.
    """
    result = np.empty(omega.size)
    for i in range(omega.size):
        x, rate, c, s = state[i]
        if x + c >= 1.0:
            result[i] = 0.0
            continue
        result[i] = np.inf
        if rate < _LEAST_RATE:
            continue
        # The limit can only be reached once the level is within the wave's amplitude of it.
        size = math.hypot(c, s)
        first = max((1.0 - size - x) / rate, 0.0)
        last = max((1.0 + size - x) / rate, first)
        steps = min(int((last - first) * omega[i] / (2.0 * math.pi) * _STEPS_A_PERIOD) + 2, 2000)
        for k in range(steps + 1):
            u = first + (last - first) * k / steps
            if x + rate * u + c * math.cos(omega[i] * u) + s * math.sin(omega[i] * u) >= 1.0:
                result[i] = u
                break
    return result
