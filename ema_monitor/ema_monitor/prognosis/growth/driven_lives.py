"""Samples of driven faults, continued into the future together with what drives them.

A sample of a unit is followed as a whole: the level of the driver in it is that of the same sample,
so that both faults share their growth, and reach their limits together more often than by chance.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core._jit import kernel
from ema_monitor.prognosis.growth.driven import Driven
from ema_monitor.prognosis.growth.filters import grown
from ema_monitor.prognosis.growth.linear_filters import RATE_SPREAD
from ema_monitor.prognosis.growth.wander import SIGMA, WANDER_HOURS

_FIRST_HOURS: Final = 2.0
_STEP: Final = 0.06
_LONGEST_HOURS: Final = 1e6
"""First step, later steps over the hours so far, and hours after which none is taken [h]."""

_PARTS: Final = 4
"""Steps that are taken from one hour that is asked for to the next."""

_NONE: Final = -1

_MOST: Final = 1.0
"""Level beyond which a driver does not go: the end of the range of a fault [-]."""


@dataclass(frozen=True, eq=False)
class DrivenDraw:
    """Samples of faults that are driven.

    Attributes
    ----------
    at
        Which of ``(7, n)`` they are: numbers of component and sample, ``(m,)`` each.
    driver
        Number of the component that drives each, ``(m,)``.
    state
        Level [-], rate of its own [1/h] and coupling [1/h], ``(m, 3)``.
    """

    at: tuple[NDArray[np.intp], NDArray[np.intp]]
    driver: NDArray[np.intp]
    state: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class OwnGrowth:
    """Growth of all components in samples that hold a driven one, by laws of their own.

    Attributes
    ----------
    law
        Number of the law in ``ema_core.growth_laws.LAWS``, ``(7, m)``.
    x, rate, shape
        Level [-] and figures of the law, ``(7, m)``.
    pace
        Logarithm of the pace [-], ``(7, m)``; NaN where the rate does not wander.
    limit
        Level at which the life of each component ends [-], ``(7,)``.
    """

    law: NDArray[np.intp]
    x: NDArray[np.float64]
    rate: NDArray[np.float64]
    shape: NDArray[np.float64]
    pace: NDArray[np.float64]
    limit: NDArray[np.float64]


def draw_driven(
    driven: Driven, cells: NDArray[np.float64], free: NDArray[np.bool_], rng: np.random.Generator
) -> DrivenDraw | None:
    """Return those of the samples of each component that are driven; None without any.

    Parameters
    ----------
    driven
        The filters.
    cells
        Probability of the cells of each component, ``(7,)``.
    free
        Samples that are under no wave, ``(7, n)``.
    rng
        Random numbers.
    """
    numbers, filters, places = [], [], []
    for number in np.flatnonzero(driven.weight.any(axis=1)):
        at = np.cumsum(driven.weight[number])
        open_to = np.flatnonzero(free[number])
        points = (rng.random() + np.arange(open_to.size)) / max(open_to.size, 1)
        points = points[points < at[-1] / (at[-1] + cells[number])] * (at[-1] + cells[number])
        filters.append(np.minimum(np.searchsorted(at, points), at.size - 1))
        numbers.append(np.full(points.size, number))
        places.append(rng.permutation(open_to)[: points.size])
    number, of_it = np.concatenate(numbers or [[]]), np.concatenate(filters or [[]])
    if not number.size:
        return None
    number, of_it = number.astype(np.intp), of_it.astype(np.intp)
    driver, state = driven.driver[number, of_it], driven.samples(number, of_it, rng)
    state[:, 1:] *= np.exp(RATE_SPREAD * rng.standard_normal(number.size))[:, None]
    # Nothing heals by what another fault does to it, and what no test has shown drives nothing:
    # such a sample goes on as it grows now.
    alone = (state[:, 2] < 0.0) | ~driven.shown[driver]
    state[alone, 1] += state[alone, 2] * driven.level[driver[alone]]
    state[alone, 2] = 0.0
    place = np.concatenate(places).astype(np.intp)
    return DrivenDraw((number, place), driver, state)


def driven_lives(
    sample: DrivenDraw, own: OwnGrowth, rates: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return hours of growth until each driven fault first reaches its limit [h], ``(m,)``.

    They are without noise; infinite where it does not.

    Parameters
    ----------
    sample
        The driven faults.
    own
        Growth of all components of those samples that ``np.unique(sample.at[1])`` names.
    rates
        Hours of growth of each component in an hour of service to come, ``(7,)`` [-].
    """
    columns = np.unique(sample.at[1], return_inverse=True)[1]
    driver = np.full(own.x.shape, _NONE)
    state = np.zeros((*own.x.shape, 3))
    driver[sample.at[0], columns] = sample.driver
    state[sample.at[0], columns] = sample.state
    drives = np.zeros(own.x.shape, dtype=bool)
    coupled = sample.state[:, 2] > 0.0
    drives[sample.driver[coupled], columns[coupled]] = True
    figures = (own.law, own.x, own.rate, own.shape, own.pace, own.limit, rates)
    # Of one layout: for each one the kernel would be compiled.
    hours = _first_passages(driver, drives, state, *map(np.ascontiguousarray, figures))
    return hours[sample.at[0], columns]


@kernel()
def _first_passages(
    driver: NDArray[np.intp],
    drives: NDArray[np.bool_],
    state: NDArray[np.float64],
    law: NDArray[np.intp],
    level: NDArray[np.float64],
    rate: NDArray[np.float64],
    shape: NDArray[np.float64],
    pace: NDArray[np.float64],
    limit: NDArray[np.float64],
    speed: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return hours of growth until driven components reach their limits [h], ``(7, m)``."""
    n, m = driver.shape
    result = np.full((n, m), np.inf)
    x, own, first = np.empty(n), np.empty(n), np.empty(n)
    for j in range(m):
        left = 0
        for i in range(n):
            x[i] = state[i, j, 0] if driver[i, j] >= 0 else min(level[i, j], _MOST)
            if driver[i, j] >= 0:
                if x[i] >= limit[i]:
                    result[i, j] = 0.0
                else:
                    left += 1
        hours = 0.0
        while left > 0 and hours < _LONGEST_HOURS:
            step = max(_FIRST_HOURS, _STEP * hours)
            # The drivers by laws of their own first, then the driven ones by Heun's method.
            for i in range(n):
                own[i] = 0.0
                if driver[i, j] >= 0:
                    by = min(max(x[driver[i, j]], 0.0), _MOST)
                    first[i] = speed[i] * (state[i, j, 1] + state[i, j, 2] * by)
                elif drives[i, j]:
                    kept = math.exp(-(hours + 0.5 * step) / WANDER_HOURS)
                    factor = 1.0
                    if not math.isnan(pace[i, j]):
                        factor = math.exp(kept * pace[i, j] - 0.5 * (SIGMA * kept) ** 2)
                    passed = factor * step * speed[i]
                    own[i] = grown(law[i, j], rate[i, j], shape[i, j], x[i], passed)
            for i in range(n):
                if driver[i, j] < 0:
                    x[i] = min(x[i] + own[i], _MOST)
            for i in range(n):
                k = driver[i, j]
                if k < 0:
                    continue
                ahead = x[k] + (first[k] * step if driver[k, j] >= 0 else 0.0)
                ahead = min(max(ahead, 0.0), _MOST)
                last = speed[i] * (state[i, j, 1] + state[i, j, 2] * ahead)
                own[i] = 0.5 * step * (first[i] + last)
            for i in range(n):
                if driver[i, j] < 0:
                    continue
                if math.isinf(result[i, j]) and x[i] + own[i] >= limit[i]:
                    passed = hours + step * (limit[i] - x[i]) / own[i]
                    result[i, j] = speed[i] * passed
                    left -= 1
                x[i] += own[i]
            hours += step
    return result


def driven_values(
    sample: DrivenDraw,
    values: NDArray[np.float64],
    start: NDArray[np.float64],
    steps: NDArray[np.float64],
) -> None:
    """Write the levels of driven faults at hours to come.

    Parameters
    ----------
    sample
        The driven faults.
    values
        Signed distances from healthy by laws of their own, ``(k, 7, n)``; those of the driven ones
        are replaced.
    start
        The same now, ``(7, n)``.
    steps
        Hours of growth from one to the next, at least 0 [h], ``(k, m)``.
    """
    number, place = sample.at
    driver, (x, rate, coupling) = sample.driver, sample.state.T
    is_driven = np.zeros(start.shape, dtype=bool)
    is_driven[number, place] = True
    chained = is_driven[driver, place]
    before, level, growth = start, start.copy(), np.zeros_like(start)
    level[number, place] = x
    for now, step in zip(values, steps, strict=True):
        part = step / _PARTS
        begin, end = (np.clip(one[driver, place], 0.0, _MOST) for one in (before, now))
        for share in np.arange(_PARTS) / _PARTS:
            behind = np.where(chained, level[driver, place], begin + share * (end - begin))
            first = rate + coupling * np.clip(behind, 0.0, _MOST)
            growth[number, place] = part * first
            # Each driver by hours of its own.
            own = np.where(chained, growth[driver, place], (end - begin) / _PARTS)
            last = rate + coupling * np.clip(behind + own, 0.0, _MOST)
            level[number, place] += 0.5 * part * (first + last)
        now[number, place] = level[number, place]
        before = now
