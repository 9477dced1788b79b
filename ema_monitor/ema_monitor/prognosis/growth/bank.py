# SPDX-License-Identifier: Apache-2.0
"""Bank of Gaussian filters, one per cell of the grid (P5).

Law, shape and rate are fixed within a cell, so the only state is the distance from healthy, which
is modelled as a Gaussian. This is a multiple-model estimator. Onset, changes and wandering rates
use the mixing step of the interacting multiple-model estimator (Bar-Shalom, Li and Kirubarajan
2001, section 11.6).
"""

import numpy as np

from ema_core.arrays import Array, Flags
from ema_monitor.prognosis.growth.cells import N_RATES, Cells, Owners
from ema_monitor.prognosis.growth.filters import LEAST_PROBABILITY, corrected, near_healthy_update
from ema_monitor.prognosis.growth.kept import Kept
from ema_monitor.prognosis.growth.laws.interface import Levels
from ema_monitor.prognosis.growth.measurement import REACH, Measurement
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings
from ema_monitor.prognosis.growth.wander import PACES, mix_paces

_STANDSTILL = 1e-3
_LEAST_VARIANCE = 1e-14


class Bank(Kept):
    """Gaussian filters of all cells.

    Attributes
    ----------
    mean, variance
        Mean [-] and variance [-] of the signed distance from healthy in each cell, ``(n,)``.
    two_sided
        Whether each component can deviate to either side of healthy, ``(7,)``.
    kind
        Kind of each cell, ``(n,)``: 0 no growth, 1 permanent law, 2 wandering rate.
    """

    kept = ("mean", "variance")

    def __init__(self, cells: Cells, settings: TrackerSettings) -> None:
        self.cells, self._settings = cells, settings
        self._sums = Owners(cells.component).sums
        self.mean = np.zeros_like(cells.prior)
        self.variance = np.ones_like(cells.prior)
        self._is_constant = np.zeros(cells.prior.size, dtype=bool)
        self._is_constant[cells.slices["constant"]] = True
        self.kind = np.where(self._is_constant, 0, np.where(cells.wanders, 2, 1))
        self._blocks = np.flatnonzero(cells.wanders).reshape(-1, PACES.size, N_RATES)
        self._laws = [
            (cells.laws[name], at, cells.figures(at)) for name, at in cells.slices.items()
        ]
        # A change seldom leads to no growth: false growth must be reversible, but a few tests that
        # do not show real growth must not stop it.
        arriving = cells.prior * np.where(self._is_constant, _STANDSTILL, 1.0)
        self._arriving = arriving / self._sums(arriving)[cells.component]
        self._leaving = np.where(
            self._is_constant, settings.onset_probability, settings.change_probability
        )
        self.two_sided = self._sums((cells.side < 0.0).astype(float)) > 0.0

    def rates(self) -> Array:
        """Return the signed growth rate of each cell [1/h], ``(n,)``."""
        rates, x = np.empty_like(self.mean), np.clip(self.cells.side * self.mean, 0.0, 1.0)
        for law, part, of in self._laws:
            rates[part] = of.side * np.minimum(law.increment(x[part], of, np.ones(1)), 1.0)
        return rates

    def advance(self, weight: Array, hours: Array) -> None:
        """Propagate all cells by the growth hours of each component, ``(7,)`` [h], and mix paces.

        ``weight``, the probability of each cell, ``(n,)``, is updated in place.
        """
        cell_hours = hours[self.cells.component]
        if cell_hours.any():
            mix_paces(
                weight, self.mean, self.variance, self._blocks, cell_hours[self._blocks[:, 0, 0]]
            )
        for law, part, figures in self._laws:
            levels = Levels(weight[part], self.mean[part], self.variance[part])
            law.advance(levels, figures, cell_hours[part], self._settings.noise_hours)

    def change(self, weight: Array) -> None:
        """Move probability between the cells by the onset and change probabilities of the settings.

        ``weight``, the probability of each cell, ``(n,)``, is updated in place.
        """
        owner = self.cells.component
        out = self._leaving * weight
        mass = np.maximum(self._sums(out), LEAST_PROBABILITY)
        new = self._arriving * mass[owner]
        total = np.maximum(weight - out + new, LEAST_PROBABILITY)
        share = new / total
        mean, variance = self.mean, self.variance
        first = self._sums(out * mean) / mass
        second = self._sums(out * (variance + mean**2)) / mass - first**2
        gap = first[owner] - mean
        variance += share * (np.maximum(second, 0.0)[owner] - variance)
        variance += share * (1.0 - share) * gap**2
        mean += share * gap
        weight[:] = total

    def measure(self, test: Measurement, plain: Flags, near: Flags) -> tuple[Array, Array]:
        """Update all cells with a test.

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
            Log-likelihood of each cell, and predicted probability of a value below the measured
            value, ``(n,)`` each. The log-likelihood is 0 for components that are neither in
            ``plain`` nor in ``near``; the probability is 0 for components that are not in
            ``plain``.
        """
        owner = self.cells.component
        log_likelihood, below = np.zeros_like(self.mean), np.zeros_like(self.mean)
        at = np.flatnonzero(plain[owner])
        k, mean, variance = owner[at], self.mean[at], self.variance[at]
        innovation = test.value[k] - mean
        update = corrected(innovation, variance + test.noise[k], self._settings)
        self.mean[at] = mean + variance * update.gain * innovation
        self.variance[at] = np.maximum(variance - variance**2 * update.shrinking, _LEAST_VARIANCE)
        log_likelihood[at], below[at] = update.log_likelihood, update.below
        at = np.flatnonzero(near[owner])
        k, mean, variance = owner[at], self.mean[at], self.variance[at]
        log_p = np.empty(at.size)
        near_healthy_update(mean, variance, test.noise[k], REACH[k], self.two_sided[k], log_p)
        self.mean[at], self.variance[at], log_likelihood[at] = mean, variance, log_p
        return log_likelihood, below

    def restart(self, number: int, value: float, variance: float) -> None:
        """Reset a component to a signed distance from healthy with the given variance."""
        at = self.cells.component == number
        self.mean[at], self.variance[at] = value, variance
