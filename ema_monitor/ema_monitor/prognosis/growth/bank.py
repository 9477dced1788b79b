"""A bank of Gaussian filters, one to each cell of the grid.

Within a cell law, shape and rate are fixed, so that what is left is one smooth scalar state, the
fault's distance from healthy, and a Gaussian holds it (two sigma points through the exact solution
of the law). The cells' probabilities carry all that is not Gaussian: which law, how bent, how fast.
This is the multiple-model estimator (Magill 1965; Bar-Shalom, Li and Kirubarajan 2001, section
11.6), with the merging of the interacting one (section 11.6.6) for the onset of growth, for changes
of it, and for rates that wander.
"""

import numpy as np

from ema_core.arrays import Array
from ema_core.faults import COMPONENTS
from ema_core.growth_laws import increment
from ema_monitor.prognosis.growth.cells import JUMPING, N_RATES, Cells, Owners
from ema_monitor.prognosis.growth.filters import (
    LEAST_PROBABILITY,
    Observation,
    corrected,
    near_healthy_update,
)
from ema_monitor.prognosis.growth.kept import Kept
from ema_monitor.prognosis.growth.measurement import REACH
from ema_monitor.prognosis.growth.settings import LIFE_HOURS, TrackerSettings
from ema_monitor.prognosis.growth.wander import PACES, mix_paces

_STANDSTILL = 1e-3
_LEAST_VARIANCE = 1e-14


class Bank(Kept):
    """Mean and variance of every cell.

    Attributes
    ----------
    mean, variance
        Signed distance from healthy in each cell [-].
    two_sided
        Components that can leave their healthy value to either side, ``(7,)``.
    kind
        0 of cells without growth, 1 of those of a law for life, 2 of those that wander.
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
        jumps = np.flatnonzero(cells.jump).reshape(-1, 2, LIFE_HOURS[::2].size)
        self._pairs = np.moveaxis(jumps, 1, 0).reshape(2, -1)
        # A change leads to growth of any kind, and seldom to none: a component seen to grow that
        # never did must find back, but not by the few tests that its growth does not show in.
        arriving = cells.prior * np.where(self._is_constant, _STANDSTILL, 1.0)
        self._arriving = arriving / self._sums(arriving)[cells.component]
        self._leaving = np.where(
            self._is_constant, settings.onset_probability, settings.change_probability
        )
        self.two_sided = self._sums((cells.side < 0.0).astype(float)) > 0.0
        self._before = self.mean, self.variance
        self._slope = np.ones_like(self.mean)

    def rates(self) -> Array:
        """Return the signed growth of each cell in the next hour [1/h]."""
        cells = self.cells
        x = np.clip(cells.side * self.mean, 0.0, 1.0)
        return cells.side * self._increments(x, np.ones(len(COMPONENTS)))

    def _increments(self, x: Array, hours: Array) -> Array:
        """Return the growth of each cell from some distances over hours of its component [h]."""
        cells, steps = self.cells, np.empty_like(x)
        for law, part in cells.slices.items():
            own = hours[cells.component[part]]
            steps[..., part] = increment(
                "linear" if law == JUMPING else law, x[..., part], cells.rate[part], cells.shape[part], own
            )
        return np.minimum(steps, 1.0)

    def advance(self, weight: Array, hours: Array) -> None:
        """Let the cells grow over hours of their component, ``(7,)`` [h]; their paces change."""
        cells = self.cells
        own = hours[cells.component]
        if own.any():
            mix_paces(weight, self.mean, self.variance, self._blocks, own[self._blocks[:, 0, 0]])
        self._before = self.mean.copy(), self.variance.copy()
        sd = np.sqrt(self.variance)
        x = np.maximum(cells.side * self.mean + np.stack([-sd, sd]), 0.0)
        step = self._increments(x, hours)
        spread = 0.5 * np.diff(x + step, axis=0)[0]
        noise = np.mean(step, axis=0) ** 2 * self._settings.noise_hours / np.where(own, own, 1.0)
        grown = (own > 0.0) & ~self._is_constant
        drifts = cells.slices["drift"]
        grown[drifts] = False
        grown[self._pairs] = False
        self._slope = np.where(grown, spread / np.where(sd > 0.0, sd, 1.0), 1.0)
        self.mean = np.where(grown, cells.side * np.mean(x + step, axis=0), self.mean)
        self.variance = np.where(grown, spread**2 + noise, self.variance)
        self.mean[drifts] += (cells.side * cells.rate * own)[drifts]
        self.variance[drifts] += (cells.diffusion**2 * own)[drifts]
        self._leap(weight, own)

    def _leap(self, weight: Array, hours: Array) -> None:
        """Let growth by jumps have none, or at least one, in the hours of each cell [h]."""
        pairs, leaps = self._pairs, self._pairs[1]
        w, mean, variance = weight[pairs], self.mean[pairs], self.variance[pairs]
        total = w.sum(axis=0)
        middle = np.sum(w / total * mean, axis=0)
        spread = np.sum(w / total * (variance + (mean - middle) ** 2), axis=0)
        self._before[0][pairs] = self.mean[pairs] = middle
        self._before[1][pairs] = self.variance[pairs] = spread
        jump = self.cells.jump[leaps]
        count = hours[leaps] * self.cells.rate[leaps] / jump
        some = -np.expm1(-count)
        weight[pairs] = np.maximum(total * np.stack([1.0 - some, some]), LEAST_PROBABILITY)
        # Moments of a sum of exponential jumps of which there is at least one.
        grown = jump * np.divide(count, some, out=np.ones_like(count), where=some > 0.0)
        self.mean[leaps] += self.cells.side[leaps] * grown
        self.variance[leaps] += grown * (2.0 * jump + jump * count - grown)

    def change(self, weight: Array) -> None:
        """Let growth begin, or become another, with the probabilities of the settings."""
        owner = self.cells.component
        out = self._leaving * weight
        mass = np.maximum(self._sums(out), LEAST_PROBABILITY)
        new = self._arriving * mass[owner]
        total = np.maximum(weight - out + new, LEAST_PROBABILITY)
        share = new / total
        # What is known of the test before changes with it.
        for mean, variance in (self._before, (self.mean, self.variance)):
            first = self._sums(out * mean) / mass
            second = self._sums(out * (variance + mean**2)) / mass - first**2
            gap = first[owner] - mean
            variance += share * (np.maximum(second, 0.0)[owner] - variance)
            variance += share * (1.0 - share) * gap**2
            mean += share * gap
        weight[:] = total

    def measure(self, test: Observation) -> tuple[Array, Array]:
        """Update the levels by a test.

        Returns logarithms of the likelihoods of the cells and the probabilities of a smaller value
        by them, ``(n,)`` each; 0 of components not shown.
        """
        owner = self.cells.component
        log_likelihood, below = np.zeros_like(self.mean), np.zeros_like(self.mean)
        at = np.flatnonzero(test.plain[owner])
        k, mean, variance = owner[at], self.mean[at], self.variance[at]
        mean_before, variance_before = self._before[0][at], self._before[1][at]
        c = test.carried[k]
        # Merged, the two variances need not fit the slope any longer.
        joint = np.minimum(self._slope[at] * variance_before, np.sqrt(variance * variance_before))
        innovation = test.value[k] - mean - c * (test.value_before[k] - mean_before)
        shared = variance - c * joint
        usual = variance - 2.0 * c * joint + c**2 * variance_before + test.fresh[k]
        told = corrected(innovation, usual, self._settings)
        self.mean[at] = mean + shared * told.gain * innovation
        self.variance[at] = np.maximum(variance - shared**2 * told.shrinking, _LEAST_VARIANCE)
        log_likelihood[at], below[at] = told.log_likelihood, told.below
        near = np.flatnonzero(test.near[owner])
        k, mean, variance = owner[near], self.mean[near], self.variance[near]
        log_p = np.empty(near.size)
        near_healthy_update(mean, variance, test.noise[k], REACH[k], self.two_sided[k], log_p)
        self.mean[near], self.variance[near], log_likelihood[near] = mean, variance, log_p
        return log_likelihood, below

    def restart(self, number: int, value: float, variance: float) -> None:
        """Start the level of a component anew at a signed distance from healthy [-]."""
        at = self.cells.component == number
        self.mean[at], self.variance[at] = value, variance
