# SPDX-License-Identifier: Apache-2.0
"""Monte Carlo forecasts of fault growth.

A fault follows its law in an effective time with random increments (P7). To first order, this is a
Wiener process with drift, whose first-passage time is inverse Gaussian (P10). If the law is
unknown, the rate may change permanently at a random time; an increase is more likely than a
decrease.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_monitor.prognosis.growth.cells import Cells
from ema_monitor.prognosis.growth.laws.interface import Figures, Future, Law
from ema_monitor.prognosis.growth.mixture import Mixture
from ema_monitor.prognosis.growth.wander import PACES, followed, hours_of
from ema_monitor.prognosis.growth.waves import WaveDraw

_PACE_SPACING: Final = float(PACES[1] - PACES[0])


@dataclass(frozen=True, eq=False)
class Draw:
    """Samples of the current state and growth, ``(7, n)`` each."""

    cells: Cells
    """Grid of the tracker."""
    noise_hours: float
    """Variance of the effective growth time per hour [h]."""
    cell: NDArray[np.intp]
    """Cell of each sample; for samples with a wave, the cell without growth."""
    x: Array
    """Distance from healthy in the direction of growth, including the wave [-]."""
    rate: Array
    """Rate of the law at pace 1."""
    pace: Array
    """Log-pace [-]."""
    change: Array
    """Growth hours until the rate changes [h]."""
    changed: Array
    """Factor of the rate after the change; 1 if it never changes [-]."""
    is_wave: Flags
    """Whether the sample has a wave."""
    waves: WaveDraw
    """States of the samples with a wave."""

    def by_law(self) -> Iterator[tuple[Law, Flags, Figures]]:
        """Yield each law, the mask of samples that follow it, and their parameters."""
        for name, part in self.cells.slices.items():
            at = (self.cell >= part.start) & (self.cell < part.stop)
            yield (
                self.cells.laws[name],
                at,
                self.cells.figures(self.cell[at])._replace(rate=self.rate[at]),
            )


def draw(mixture: Mixture, n: int, observed: Array, rng: np.random.Generator) -> Draw:
    """Return random samples of the state and growth of a unit.

    Parameters
    ----------
    mixture
        Probabilities of all cells and waves.
    n
        Number of samples.
    observed
        Hours over which each growing component has been observed, ``(7,)`` [h]; 0 for components
        that do not grow.
    rng
        Random number generator.
    """
    bank, cells = mixture.bank, mixture.bank.cells
    chosen = np.empty((len(mixture.members), n), dtype=np.intp)
    for number, members in enumerate(mixture.members):
        # Systematic sampling reproduces the probabilities to within one sample.
        at = np.cumsum(mixture.weight[members])
        points = (rng.random() + np.arange(n)) / n * at[-1]
        chosen[number] = rng.permutation(
            members[np.minimum(np.searchsorted(at, points), at.size - 1)]
        )
    is_wave = chosen >= bank.mean.size
    number, filters = np.nonzero(is_wave)[0], chosen[is_wave] - bank.mean.size
    waves = mixture.waves.drawn(number, filters % mixture.waves.omega.size, rng)
    still = np.arange(len(chosen))[:, None] + cells.slices["constant"].start
    cell = np.where(is_wave, still, chosen)
    sd = np.sqrt(bank.variance[cell])
    x = cells.side[cell] * (bank.mean[cell] + sd * rng.standard_normal(cell.shape))
    x[is_wave] = waves.state[:, 0] + waves.state[:, 2]
    # Spread rates and paces uniformly between grid points.
    rate = cells.base[cell] * np.exp(cells.spacing[cell] * (rng.random(cell.shape) - 0.5))
    pace = cells.pace[cell] + cells.wanders[cell] * _PACE_SPACING * (rng.random(cell.shape) - 0.5)
    # Growth observed for u hours continues for t more hours with probability u / (u + t).
    change = observed[:, None] * np.expm1(rng.standard_exponential(cell.shape))
    slowest, fastest = mixture.mechanisms.changed
    changed = slowest * (fastest / slowest) ** rng.random(cell.shape)
    changed[is_wave | cells.is_random[cell] | (mixture.is_known | (observed == 0.0))[:, None]] = 1.0
    noise_hours = mixture.settings.noise_hours
    return Draw(cells, noise_hours, cell, x, rate, pace, change, changed, is_wave, waves)


def lives(sample: Draw, rng: np.random.Generator) -> Array:
    """Return the growth hours until each sample first reaches its limit, ``(7, n)`` [h].

    The hours are infinite if the sample never reaches its limit.
    """
    hours, scale = np.empty(sample.cell.shape), np.empty(sample.cell.shape)
    for law, at, of in sample.by_law():
        hours[at], scale[at] = law.passage(sample.x[at], of, sample.noise_hours, rng)
    # Decelerating growth may never reach the limit.
    hours[np.isnan(hours)] = np.inf
    passing = np.isfinite(hours) & (hours > 0.0) & (scale > 0.0)
    hours[passing] = rng.wald(hours[passing], scale[passing])
    wandering = sample.cells.wanders[sample.cell] & passing
    hours[wandering] = hours_of(hours[wandering], sample.pace[wandering], rng)
    hours[sample.is_wave] = sample.waves.lives()
    after = hours - sample.change
    return np.where(after > 0.0, sample.change + after / sample.changed, hours)


def futures(sample: Draw, hours: Array, rng: np.random.Generator) -> Array:
    """Return samples of the future signed distances from healthy, ``(m, 7, n)``.

    Parameters
    ----------
    sample
        Samples of the current state and growth.
    hours
        Ascending growth hours from now [h], broadcastable to ``(m, 7, n)``.
    rng
        Random number generator.
    """
    shape = (len(hours), *sample.cell.shape)
    after = hours - sample.change
    hours = np.where(after > 0.0, sample.change + after * sample.changed, hours)
    steps = np.diff(hours, axis=0, prepend=0.0)
    wiener = np.cumsum(np.sqrt(steps) * rng.standard_normal(shape), axis=0)
    wanders, paced = sample.cells.wanders[sample.cell], hours.copy()
    normal = rng.standard_normal((len(steps), int(wanders.sum())))
    passed = followed(sample.pace[wanders], np.ascontiguousarray(steps[:, wanders]), normal)
    paced[:, wanders] = np.cumsum(passed, axis=0)
    ahead = Future(hours, paced, np.sqrt(sample.noise_hours) * wiener, wiener)
    values = np.empty(shape)
    for law, at, of in sample.by_law():
        followed_by = Future(*(column[:, at] for column in ahead))
        values[:, at] = of.side * law.future(sample.x[at], of, followed_by, rng)
    values[:, sample.is_wave] = sample.waves.values(hours[:, sample.is_wave])
    return values
