# SPDX-License-Identifier: Apache-2.0
"""Mixture of all growth hypotheses of a unit: grid cells and waves.

Probabilities are exact Bayesian posteriors, except for wandering rates, waves and the kind of
growth, whose evidence is discounted over time (P6b).
"""

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.bank import Bank
from ema_monitor.prognosis.growth.cells import Owners, grid
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY
from ema_monitor.prognosis.growth.fleet_prior import with_fleet
from ema_monitor.prognosis.growth.kept import Kept
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.mechanisms import MECHANISMS, Mechanisms
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings
from ema_monitor.prognosis.growth.waves import Waves

_N = len(COMPONENTS)
_WANDERS, _WAVE = 2, 3


class Mixture(Kept):
    """Joint filter of grid cells and waves.

    Attributes
    ----------
    weight
        Probability of each cell, followed by each filter of a wave, ``(n,)``; sums to 1 for each
        component.
    component, members
        Component number of each cell and filter, ``(n,)``, and indices of the cells and filters of
        each component.
    is_known
        Whether the law of each component is known, ``(7,)``.
    """

    kept = ("weight",)
    parts = ("bank", "waves")

    def __init__(
        self, limits: HealthLimits, settings: TrackerSettings, mechanisms: Mechanisms = MECHANISMS
    ) -> None:
        self.settings, self.mechanisms = settings, mechanisms
        cells = with_fleet(grid(limits, settings, mechanisms), settings)
        self.bank = Bank(cells, settings)
        self.waves = waves = Waves(limits, settings, self.bank.two_sided, mechanisms.wave)
        number = np.arange(_N)
        self.component = np.concatenate([cells.component, np.repeat(number, waves.omega.size)])
        self._sums = Owners(self.component).sums
        self.members = [np.flatnonzero(self.component == i) for i in number]
        # Waves do not change the prior probability of growth.
        of_cells = cells.prior * (1.0 - waves.prior.sum(axis=1))[cells.component]
        self._prior = np.concatenate([of_cells, waves.prior.ravel()])
        self.weight = self._prior.copy()
        # Kinds of growth: none, permanent law, wandering rate, growth with a wave.
        kind = np.concatenate([self.bank.kind, np.tile(np.where(waves.grows, _WAVE, 0), _N)])
        self._is_constant = kind == 0
        self._is_random = np.append(cells.is_random, np.zeros(waves.prior.size))
        self._forgets = np.flatnonzero(kind >= _WANDERS)
        self._kind = kind * _N + self.component
        self._kinds_prior = self._of_kinds(self._prior)
        self.is_known = np.array([name in settings.laws for name in COMPONENTS])
        self._power = np.where(self.is_known, 1.0, settings.forgetting)

    def _split(self, values: Array) -> tuple[Array, Array]:
        """Return views of values for cells, ``(n,)``, and waves, ``(7, k)``."""
        n = self.bank.mean.size
        return values[:n], values[n:].reshape(_N, -1)

    def _of_kinds(self, values: Array) -> Array:
        """Return the sums of values by kind of growth and component, ``(4, 7)``."""
        sums = np.bincount(self._kind, values, 4 * _N).astype(np.float64, copy=False)
        return sums.reshape(4, _N)

    def moments(self) -> tuple[Array, Array]:
        """Return mean and variance of each signed distance from healthy, ``(7,)`` each."""
        bank, (mean, variance) = self.bank, self.waves.moments()
        values = np.append(bank.mean, mean)
        mean = self._sums(self.weight * values)
        spread = np.append(bank.variance, variance) + (values - mean[self.component]) ** 2
        return mean, self._sums(self.weight * spread)

    def trend(self) -> Array:
        """Return the mean signed growth rate of each component, ``(7,)`` [1/h]."""
        return self._sums(self.weight * np.append(self.bank.rates(), self.waves.rates()))

    def constant(self) -> Array:
        """Return the probability that each component does not grow, ``(7,)`` [-]."""
        return self._sums(self.weight * self._is_constant)

    def is_random(self) -> Array:
        """Return the probability that each component grows by jumps or drift, ``(7,)`` [-]."""
        return self._sums(self.weight * self._is_random)

    def advance(self, hours: Array) -> None:
        """Propagate each component by its growth hours, at least 0, ``(7,)`` [h]."""
        of_cells, of_waves = self._split(self.weight)
        self.bank.advance(of_cells, hours)
        self.waves.advance(of_waves, hours)

    def _forget(self, used: Flags) -> None:
        """Discount old evidence: move probabilities of the used components towards their priors."""
        power = np.where(used, self._power, 1.0)
        before, at = self._of_kinds(self.weight), self._forgets
        # Discount wandering rates and waves only; evidence for a permanent law accumulates.
        self.weight[at] = _tempered(self.weight[at], self._prior[at], power[self.component[at]])
        target = before.copy()
        target[1:] = _tempered(before[1:], self._kinds_prior[1:], power)
        target[1:] *= before[1:].sum(axis=0) / np.maximum(target[1:].sum(axis=0), LEAST_PROBABILITY)
        factor = target / np.maximum(self._of_kinds(self.weight), LEAST_PROBABILITY)
        self.weight *= factor.ravel()[self._kind]

    def measure(self, test: Measurement, used: Flags) -> Array:
        """Update with a test, for the components in ``used``, ``(7,)``.

        Return the predicted probability of a value below the measured value, ``(7,)``. It is
        meaningless for components that are not used or that were set to healthy.
        """
        self._forget(used)
        self.bank.change(self._split(self.weight)[0])
        near = used & test.near_healthy
        selection = test, used & ~near, near
        updates = self.bank.measure(*selection), self.waves.measure(*selection)
        log_p, below = (
            np.concatenate([cells, waves.ravel()]) for cells, waves in zip(*updates, strict=True)
        )
        pit = self._sums(self.weight * below)
        highest = np.full(_N, -np.inf)
        np.maximum.at(highest, self.component, np.where(self._prior > 0.0, log_p, -np.inf))
        weight = self.weight * np.exp(np.minimum(log_p - highest[self.component], 0.0))
        weight /= self._sums(weight)[self.component]
        self.weight = np.where(self._prior > 0.0, np.maximum(weight, LEAST_PROBABILITY), 0.0)
        return pit

    def restart(self, number: int, value: float, noise: float, *, keep: float) -> None:
        """Reset the level of a component to a measured value.

        Parameters
        ----------
        number
            Index of the component.
        value, noise
            Measured signed distance from healthy [-], and its error variance [-].
        keep
            How much of the learnt growth to retain: 0 returns to the prior, 1 retains everything.
        """
        for part in (self.bank, self.waves):
            part.restart(number, value, noise + self.settings.occasional_error**2)
        at = self.members[number]
        weight = _tempered(self.weight[at], self._prior[at], np.float64(keep))
        self.weight[at] = weight / weight.sum()


def _tempered(weight: Array, prior: Array, power: Array | np.float64) -> Array:
    """Return ``weight**power * prior**(1 - power)``, not normalized."""
    kept = np.maximum(weight, LEAST_PROBABILITY) ** power * prior ** (1.0 - power)
    return np.where(prior > 0.0, kept, 0.0)
