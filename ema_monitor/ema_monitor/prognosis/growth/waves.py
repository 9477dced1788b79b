"""Filters for faults under a wave: periodic effects of season, temperature or load (P6c).

The state of a filter is level x, rate v, and a wave w of known period and unknown amplitude and
phase: it turns by 2 pi hours / period, and amplitude and phase change slowly. A test measures
x + w.
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
"""Periods of the waves on the grid [h]."""

AMPLITUDE: Final = 0.025
"""Standard deviation of each of the two parts of a wave, as a share of the limit [-]."""

LASTING: Final = 20.0
"""Correlation time of amplitude and phase of a wave [periods]."""

RATE_SPREAD: Final = 0.15
"""Standard deviation of the logarithm of the future mean rate over the present rate [-]."""

_RATE_WALK: Final = 0.01
"""Relative random walk of the rate [1/sqrt(h)]."""

_LIVES: Final = np.array([np.inf, 2500.0, 600.0])
"""Hours to the limit at one standard deviation of the rate [h]; infinite without growth."""

_SEEN: Final = np.array([1.0, 0.0, 1.0, 0.0])
_LEAST_RATE: Final = 1e-6
"""Smallest rate that counts as growth, in shares of the limit [1/h]."""

_STEPS_A_PERIOD: Final = 20


class Waves(Kept):
    """Filters of waves: states are x, v and the parts of w, a test measures x + w.

    Attributes
    ----------
    prior
        Probabilities before any test, ``(7, k)``; their sum for a component is ``prior``, or 0 if
        its law is known.
    grows
        Filters whose level grows, ``(k,)``.
    mean, covariance
        Mean and covariance of the states, ``(7, k, 4)`` and ``(7, k, 4, 4)``.
    omega
        Angular frequency of the wave [rad/h], ``(k,)``.
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
        """Return mean and variance of a test's value as each filter predicts it, ``(7, k)``."""
        return self.mean @ _SEEN, self.covariance @ _SEEN @ _SEEN

    def restart(self, number: int, value: float, variance: float) -> None:
        """Reset a component to a signed distance from healthy, with unknown wave and rate."""
        wave = self._wave_variance[number]
        self.mean[number] = [value, 0.0, 0.0, 0.0]
        covariance = np.zeros_like(self.covariance[number])
        # The level is the value without the wave.
        covariance[:, 0, 0] = variance + wave
        covariance[:, 0, 2] = covariance[:, 2, 0] = -wave
        covariance[:, 1, 1] = self._rate_variance[number]
        covariance[:, 2, 2] = covariance[:, 3, 3] = wave
        self.covariance[number] = covariance

    def rates(self) -> Array:
        """Return the rate of growth of each filter without its wave [1/h], ``(7, k)``."""
        return np.where(self.grows, self.mean[..., 1], 0.0)

    def advance(self, weight: Array, hours: Array) -> None:
        """Advance the filters by hours of their component, ``(7,)`` [h]; growth may begin."""
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
        """Apply the probability that growth begins in filters without growth."""
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
        """Update the filters by a test.

        Parameters
        ----------
        test
            The test.
        plain, near
            Components with a measured value, and components set to healthy, ``(7,)``.

        Returns
        -------
        tuple of numpy.ndarray
            Logarithms of the likelihoods of the filters, and their predicted probabilities of a
            smaller value, ``(7, k)`` each; 0 for components not shown.
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
        self, number: NDArray[np.intp], of_it: NDArray[np.intp], rng: np.random.Generator
    ) -> "WaveDraw":
        """Return a sample for each pair of numbers of a component and of its filter."""
        pairs, which = np.unique(number * self.omega.size + of_it, return_inverse=True)
        covariance = self.covariance.reshape(-1, 4, 4)[pairs]
        values, vectors = np.linalg.eigh(covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        normal = rng.standard_normal((number.size, 4))
        state = self.mean[number, of_it] + np.einsum("mij,mj->mi", root[which], normal)
        spread = np.exp(RATE_SPREAD * rng.standard_normal(number.size))
        state[:, 1] *= np.where(self.grows[of_it], spread, 0.0)
        # Growth may go to either side only for two-sided components.
        side = np.where(self.two_sided[number] & (state[:, 1] < 0.0), -1.0, 1.0)
        return WaveDraw(state, self.omega[of_it], side / self._limit[number])


@dataclass(frozen=True, eq=False)
class WaveDraw:
    """Samples under a wave."""

    state: Array  # signed level, rate [1/h] and the parts of the wave, (m, 4)
    omega: Array  # turn of the wave [rad/h], (m,)
    scale: Array  # one over the limit to which it grows, signed, (m,)

    def lives(self) -> Array:
        """Return hours until each sample first reaches its limit [h], ``(m,)``."""
        return _first_passages(self.state * self.scale[:, None], self.omega)

    def values(self, hours: Array) -> Array:
        """Return signed distances from healthy after hours of each [h], ``(k, m)``."""
        x, rate, c, s = self.state.T
        turn = hours * self.omega
        return x + rate * hours + c * np.cos(turn) + s * np.sin(turn)


@kernel()
def _first_passages(state: Array, omega: Array) -> Array:
    """Return hours until level and wave first reach 1 [h], ``(m,)``."""
    result = np.empty(omega.size)
    for i in range(omega.size):
        x, rate, c, s = state[i]
        if x + c >= 1.0:
            result[i] = 0.0
            continue
        result[i] = np.inf
        if rate < _LEAST_RATE:
            continue
        # The limit is out of reach until its distance from the level is below the wave's size.
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
