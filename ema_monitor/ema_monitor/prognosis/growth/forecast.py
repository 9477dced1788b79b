"""Samples of a bank of filters, continued into the future.

Process noise multiplies each increment by a factor, so a fault grows as its law says, in a time
of its own whose increments are random with mean 1. To first order in the variance that time is a
Wiener process with drift, and the hours until it reaches those of the noiseless law follow an
inverse Gaussian; of drift and diffusion they do so exactly (Chhikara and Folks, The Inverse
Gaussian Distribution, 1989).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema_core.growth_laws import hours_until, increment
from ema_monitor.prognosis.growth.bank import Bank
from ema_monitor.prognosis.growth.cells import RATE_SPACING, Cells


@dataclass(frozen=True, eq=False)
class Draw:
    """Samples of state and growth, ``(7, n)`` each.

    Attributes
    ----------
    cells, noise_hours
        The grid, and the bank's variance of the effective time per hour [h].
    cell
        Cell number.
    x
        Distance from healthy, towards the side to which the cell grows [-].
    rate
        Rate of the law.
    """

    cells: Cells
    noise_hours: float
    cell: NDArray[np.intp]
    x: NDArray[np.float64]
    rate: NDArray[np.float64]


def draw(bank: Bank, n: int, rng: np.random.Generator) -> Draw:
    """Return n samples of each component of a bank."""
    cells = bank.cells
    cell = np.empty((len(bank.members), n), dtype=np.intp)
    for number, of_it in enumerate(bank.members):
        # Systematic sampling: the cells' shares come out exact to one sample.
        at = np.cumsum(bank.weight[of_it])
        points = (rng.random() + np.arange(n)) / n * at[-1]
        cell[number] = rng.permutation(of_it[np.minimum(np.searchsorted(at, points), at.size - 1)])
    sd = np.sqrt(bank.variance[cell])
    x = cells.side[cell] * (bank.mean[cell] + sd * rng.standard_normal(cell.shape))
    # The grid's rates stand for the cells between them.
    rate = cells.rate[cell] * np.exp(RATE_SPACING * (rng.random(cell.shape) - 0.5))
    return Draw(cells, bank.noise_hours, cell, x, rate)


def lives(sample: Draw, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return hours until each sample first reaches its limit [h], ``(7, n)``."""
    cells, cell = sample.cells, sample.cell
    hours = np.empty(cell.shape)
    scale = np.empty(cell.shape)
    for law, part in cells.slices.items():
        at = (cell >= part.start) & (cell < part.stop)
        own = cell[at]
        is_drift, limit = law == "drift", cells.limit[own]
        x = sample.x[at] if is_drift else np.maximum(sample.x[at], 0.0)
        hours[at] = hours_until(law, x, sample.rate[at], cells.shape[own], limit)
        if is_drift:
            scale[at] = ((limit - x) / cells.diffusion[own]) ** 2
        else:
            scale[at] = hours[at] ** 2 / max(sample.noise_hours, 1e-12)
    passing = np.isfinite(hours) & (hours > 0.0) & (scale > 0.0)
    hours[passing] = rng.wald(hours[passing], scale[passing])
    return hours


def futures(
    sample: Draw, hours: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return signed distances from healthy in the future, ``(m, 7, n)``.

    Parameters
    ----------
    sample
        State and growth now.
    hours
        Ascending hours from now on [h], ``(m,)``.
    rng
        Random numbers.
    """
    cells, cell = sample.cells, sample.cell
    side = cells.side[cell]
    steps = np.diff(hours, prepend=0.0)
    wiener = np.cumsum(
        np.sqrt(steps)[:, None, None] * rng.standard_normal((hours.size, *cell.shape)), axis=0
    )
    values = np.empty((hours.size, *cell.shape))
    time = hours[:, None]
    for law, part in cells.slices.items():
        at = (cell >= part.start) & (cell < part.stop)
        own = cell[at]
        x, rate = sample.x[at], sample.rate[at]
        if law == "drift":
            grown = x + rate * time + cells.diffusion[own] * wiener[:, at]
        elif law == "constant":
            grown = x + 0.0 * time
        else:
            x = np.maximum(x, 0.0)
            own_time = np.maximum(time + np.sqrt(sample.noise_hours) * wiener[:, at], 0.0)
            own_time = np.maximum.accumulate(own_time, axis=0)
            grown = x + increment(law, x, rate, cells.shape[own], own_time)
        values[:, at] = side[at] * grown
    return values
