"""A bank of Gaussian filters, one to each cell of the grid, with the cells' probabilities.

Within a cell law, shape and rate are fixed, so that what is left is one smooth scalar state, the
fault's distance from healthy, and a Gaussian holds it (unscented transform through the exact
solution of the law). The cells' probabilities carry all that is not Gaussian: which law, how
bent, how fast. This is the multiple-model estimator (Magill 1965; Bar-Shalom, Li and Kirubarajan
2001, section 11.6), with the merging of the interacting one (section 11.6.6) for the onset of
growth, for changes of it, and for rates that wander.
"""

from copy import copy

import numpy as np
from numpy.typing import NDArray

from ema_core.growth_laws import LAWS
from ema_monitor.prognosis.growth.cells import N_WANDERING_RATES, Cells
from ema_monitor.prognosis.growth.filters import (
    LEAST_PROBABILITY,
    change_cells,
    grow_cells,
    measure_cells,
)
from ema_monitor.prognosis.growth.measurement import REACH
from ema_monitor.prognosis.growth.near_healthy import near_healthy_update
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.wander import mix_paces, transition

_STANDSTILL = 1e-3


class Bank:
    """Probability, mean and variance of every cell.

    Parameters
    ----------
    cells
        The grid.
    settings
        Noise and probabilities.

    Attributes
    ----------
    weight
        Probability of each cell; sums to 1 over the cells of a component, or to 1 with those of
        its waves and of what drives it.
    mean, variance
        Signed distance from healthy in each cell [-].
    members
        Numbers of the cells of each component.
    noise_hours
        Variance of the effective time of growth per hour in service [h].
    """

    def __init__(self, cells: Cells, settings: TrackerSettings) -> None:
        self.cells = cells
        self._settings = settings
        self.weight = cells.prior.copy()
        self.mean = np.zeros_like(cells.prior)
        self.variance = np.ones_like(cells.prior)
        self._n = int(cells.component.max()) + 1
        self.members = [np.flatnonzero(cells.component == number) for number in range(self._n)]
        # Cells of a component lie side by side in each law.
        self._runs = np.flatnonzero(np.diff(cells.component, prepend=-1))
        self._constant = cells.slices["constant"]
        self.noise_hours = settings.noise_hours
        # A change leads to growth of any kind, and seldom to none: a component seen to grow that
        # never did must find back, but not by the few tests that its growth does not show in.
        arriving = cells.prior.copy()
        arriving[self._constant] *= _STANDSTILL
        self._arriving = arriving / self.sums(arriving)[cells.component]
        self.two_sided = self.sums((cells.side < 0.0).astype(float)) > 0.0
        self._two_sided = self.two_sided[cells.component]
        self._law = np.repeat(
            [LAWS.index(law) for law in cells.slices],
            [part.stop - part.start for part in cells.slices.values()],
        )
        self._before = self.mean.copy(), self.variance.copy()
        self._slope = np.ones_like(self.mean)

    def frozen(self) -> "Bank":
        """Return a copy that does not change with this one."""
        twin = copy(self)
        twin.weight, twin.mean = self.weight.copy(), self.mean.copy()
        twin.variance = self.variance.copy()
        return twin

    def sums(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sums of values of the cells over each component, ``(7,)``."""
        owner = self.cells.component[self._runs]
        total = np.bincount(owner, np.add.reduceat(values, self._runs), self._n)
        return total.astype(np.float64, copy=False)

    def moments(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return mean and variance of each component's signed distance, ``(7,)`` each."""
        total = np.maximum(self.sums(self.weight), LEAST_PROBABILITY)
        mean = self.sums(self.weight * self.mean) / total
        away = self.mean - mean[self.cells.component]
        return mean, self.sums(self.weight * (self.variance + away**2)) / total

    def diffusion(self) -> NDArray[np.float64]:
        """Return the root mean square diffusion of each component [1/sqrt(h)], ``(7,)``."""
        total = np.maximum(self.sums(self.weight), LEAST_PROBABILITY)
        return np.sqrt(self.sums(self.weight * self.cells.diffusion**2) / total)

    def advance(self, hours: NDArray[np.float64]) -> None:
        """Let the cells of each component grow over hours of its own, ``(7,)`` [h]."""
        states = (self.weight, self.mean, self.variance)
        own, blocks = hours[self.cells.component], self.cells.blocks
        for elapsed in np.unique(hours[hours > 0.0]):
            at = blocks[own[blocks] == elapsed]
            mix_paces(*states, at, N_WANDERING_RATES, transition(float(elapsed)))
        self._before = self.mean.copy(), self.variance.copy()
        self._slope = np.ones_like(self.mean)
        if not own.any():
            return
        cells = self.cells
        for law, part in cells.slices.items():
            if law == "constant":
                continue
            if law == "drift":
                self.mean[part] += cells.side[part] * cells.rate[part] * own[part]
                self.variance[part] += cells.diffusion[part] ** 2 * own[part]
                continue
            figures = (self._law, cells.side, cells.rate, cells.shape)
            states = (self.mean, self.variance, self._slope)
            grow_cells(*(one[part] for one in (*figures, *states, own)), self.noise_hours)

    def change(self) -> None:
        """Let growth begin, or become another, with the probabilities of the settings."""
        settings, component = self._settings, self.cells.component
        leaving = np.full_like(self.weight, settings.change_probability)
        leaving[self._constant] = settings.onset_probability
        # What is known of the test before changes with it.
        for weight, mean, variance in (
            (self.weight.copy(), *self._before),
            (self.weight, self.mean, self.variance),
        ):
            change_cells(weight, mean, variance, component, leaving, self._arriving, self._n)

    def measure(
        self,
        value: NDArray[np.float64],
        noise: NDArray[np.float64],
        used: NDArray[np.bool_],
        near_healthy: NDArray[np.bool_],
        carried: NDArray[np.float64],
        fresh: NDArray[np.float64],
        value_before: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Update the levels of all cells by a test.

        Parameters
        ----------
        value, noise
            Signed distances from healthy and variances of their errors, ``(7,)``.
        used, near_healthy
            Components that the test shows, and those of them that were set to healthy, ``(7,)``.
        carried, fresh, value_before
            As of ``measure_cells``.

        Returns
        -------
        tuple
            Logarithms of the likelihoods of the cells and the probabilities of a smaller value by
            them, ``(n,)`` each; 0 of components not shown.
        """
        component = self.cells.component
        log_likelihood, below = np.zeros_like(self.weight), np.zeros_like(self.weight)
        plain = np.flatnonzero((used & ~near_healthy)[component])
        settings = self._settings
        states = (self.mean, self.variance, self._slope, *self._before)
        measure_cells(
            *(plain, component, *states, value, fresh, carried, value_before),
            *(settings.occasional_error, settings.occasional_probability, log_likelihood, below),
        )
        near = np.flatnonzero((used & near_healthy)[component])
        mean, variance = self.mean[near], self.variance[near]
        log_p = np.empty(near.size)
        own = component[near]
        near_healthy_update(mean, variance, noise[own], REACH[own], self._two_sided[near], log_p)
        self.mean[near], self.variance[near], log_likelihood[near] = mean, variance, log_p
        return log_likelihood, below

    def restart(self, component: int, value: float, variance: float) -> None:
        """Start a component's level anew.

        Parameters
        ----------
        component, value, variance
            Number of the component, its new signed distance from healthy, and its variance [-].
        """
        at = self.members[component]
        self.mean[at], self.variance[at] = value, variance
