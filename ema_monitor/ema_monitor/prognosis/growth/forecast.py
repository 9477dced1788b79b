"""Samples of what is known of growth, continued into the future.

Process noise multiplies each increment by a factor, so a fault grows as its law says, in a time
of its own whose increments are random with mean 1. To first order in the variance that time is a
Wiener process with drift, and the hours until it reaches those of the noiseless law follow an
inverse Gaussian; of drift and diffusion they do so exactly (Chhikara and Folks, The Inverse
Gaussian Distribution, 1989). Where the rate wanders, that time runs at the pace.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.growth_laws import hours_until, increment
from ema_monitor.prognosis.growth import wander
from ema_monitor.prognosis.growth.bank import Bank
from ema_monitor.prognosis.growth.cells import Cells
from ema_monitor.prognosis.growth.mixture import Mixture
from ema_monitor.prognosis.growth.wave_lives import WaveDraw, draw_waves, wave_lives, wave_values

_PACE_SPACING: Final = float(wander.PACES[1] - wander.PACES[0])


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
        Distance from healthy, towards the side to which the cell grows, with its wave [-].
    rate
        Rate of the law at pace 1.
    pace
        Logarithm of the pace [-].
    waves
        Those samples that are under a wave, in place of those of the cells.
    """

    cells: Cells
    noise_hours: float
    cell: NDArray[np.intp]
    x: NDArray[np.float64]
    rate: NDArray[np.float64]
    pace: NDArray[np.float64]
    waves: WaveDraw | None = None


def draw_cells(bank: Bank, n: int, rng: np.random.Generator) -> Draw:
    """Return n samples of each component by the cells of a bank."""
    cells = bank.cells
    cell = np.empty((len(bank.members), n), dtype=np.intp)
    for number, of_it in enumerate(bank.members):
        # Systematic sampling: the cells' shares come out exact to one sample.
        at = np.cumsum(bank.weight[of_it])
        points = (rng.random() + np.arange(n)) / n * at[-1]
        cell[number] = rng.permutation(of_it[np.minimum(np.searchsorted(at, points), at.size - 1)])
    sd = np.sqrt(bank.variance[cell])
    x = cells.side[cell] * (bank.mean[cell] + sd * rng.standard_normal(cell.shape))
    # The grid's rates and paces stand for what lies between them.
    rate = cells.base[cell] * np.exp(cells.spacing[cell] * (rng.random(cell.shape) - 0.5))
    wanders = cells.wanders[cell]
    between = _PACE_SPACING * (rng.random(cell.shape) - 0.5)
    pace = cells.pace[cell] + np.where(wanders, between, 0.0)
    return Draw(cells, bank.noise_hours, cell, x, rate, pace)


def draw(mixture: Mixture, n: int, rng: np.random.Generator) -> Draw:
    """Return n samples of a unit: of each component by its cells and filters."""
    by_cells = draw_cells(mixture.bank, n, rng)
    cells, cell, x = by_cells.cells, by_cells.cell, by_cells.x
    waves = draw_waves(mixture.waves, n, rng)
    if waves is not None:
        x[waves.at] = cells.side[cell[waves.at]] * (waves.state[:, 0] + waves.state[:, 2])
    return replace(by_cells, waves=waves)


def lives(sample: Draw, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return hours of growth until each sample first reaches its limit [h], ``(7, n)``.

    Parameters
    ----------
    sample
        State and growth now.
    rng
        Random numbers.
    """
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
    # Growth that slows down may never get there.
    hours[np.isnan(hours)] = np.inf
    passing = np.isfinite(hours) & (hours > 0.0) & (scale > 0.0)
    hours[passing] = rng.wald(hours[passing], scale[passing])
    wandering = cells.wanders[cell] & passing
    normal = rng.standard_normal((int(wandering.sum()), wander.STEPS))
    hours[wandering] = wander.hours_of(hours[wandering], sample.pace[wandering], normal)
    if sample.waves is not None:
        hours[sample.waves.at] = wave_lives(sample.waves, cells)
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
        Ascending hours of growth from now on [h], in a form that broadcasts to ``(m, 7, n)``.
    rng
        Random numbers.
    """
    cells, cell = sample.cells, sample.cell
    side = cells.side[cell]
    steps = np.diff(hours, axis=0, prepend=0.0)
    shape = (len(hours), *cell.shape)
    hours = np.broadcast_to(hours, shape)
    wiener = np.cumsum(np.sqrt(steps) * rng.standard_normal(shape), axis=0)
    values = np.empty(shape)
    time = _paced(sample, steps, rng)
    for law, part in cells.slices.items():
        at = (cell >= part.start) & (cell < part.stop)
        own = cell[at]
        x, rate = sample.x[at], sample.rate[at]
        if law == "drift":
            grown = x + rate * hours[:, at] + cells.diffusion[own] * wiener[:, at]
        elif law == "constant":
            grown = x + 0.0 * hours[:, at]
        else:
            x = np.maximum(x, 0.0)
            own_time = _own_time(sample, time[:, at], wiener[:, at])
            grown = x + increment(law, x, rate, cells.shape[own], own_time)
        values[:, at] = side[at] * grown
    if sample.waves is not None:
        values[:, *sample.waves.at] = wave_values(sample.waves, hours[:, *sample.waves.at])
    return values


def _own_time(
    sample: Draw, time: NDArray[np.float64], wiener: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return times of growth with their noise [h], ``(m, k)``: they do not run backwards."""
    noisy = time + np.sqrt(sample.noise_hours) * wiener
    return np.maximum.accumulate(np.maximum(noisy, 0.0), axis=0)


def _paced(
    sample: Draw, steps: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return the times of growth after some steps [h], ``(m, 7, n)``."""
    wanders = sample.cells.wanders[sample.cell]
    steps = np.broadcast_to(steps, (len(steps), *sample.cell.shape))
    times = np.cumsum(steps, axis=0)
    pace = sample.pace[wanders]
    passed = np.zeros(pace.size)
    for number, step in enumerate(steps[:, wanders]):
        kept = np.exp(-step / wander.WANDER_HOURS)
        spread = wander.SIGMA * np.sqrt(1.0 - kept**2)
        after = kept * pace + spread * rng.standard_normal(pace.size)
        passed = passed + 0.5 * step * np.exp(-wander.LOG_MEAN) * (np.exp(pace) + np.exp(after))
        times[number, wanders] = passed
        pace = after
    return times
