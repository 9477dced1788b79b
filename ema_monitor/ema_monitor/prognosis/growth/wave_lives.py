"""Samples of faults under a wave, continued into the future."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core._jit import kernel
from ema_monitor.prognosis.growth.cells import Cells
from ema_monitor.prognosis.growth.waves import RATE_SPREAD, Waves

_LEAST_RATE: Final = 1e-6
"""Rate, in shares of the limit, below which nothing grows [1/h]."""

_STEPS_A_PERIOD: Final = 20


@dataclass(frozen=True, eq=False)
class WaveDraw:
    """Samples under a wave.

    Attributes
    ----------
    at
        Which of ``(7, n)`` they are: numbers of component and sample, ``(m,)`` each.
    state
        Signed level, rate [1/h] and the parts of the wave, ``(m, 4)``.
    omega
        Turn of the wave [rad/h], ``(m,)``.
    """

    at: tuple[NDArray[np.intp], NDArray[np.intp]]
    state: NDArray[np.float64]
    omega: NDArray[np.float64]


def draw_waves(waves: Waves, n: int, rng: np.random.Generator) -> WaveDraw | None:
    """Return those of n samples of each component that are under a wave; None without any."""
    numbers, filters = [], []
    for number, weight in enumerate(waves.weight):
        at = np.cumsum(weight)
        points = (rng.random() + np.arange(n)) / n
        chosen = np.searchsorted(at, points[points < at[-1]])
        numbers.append(np.full(chosen.size, number))
        filters.append(np.minimum(chosen, weight.size - 1))
    number, of_it = np.concatenate(numbers), np.concatenate(filters)
    if not number.size:
        return None
    places = [rng.permutation(n)[: one.size] for one in numbers]
    state = waves.samples(number, of_it, rng)
    spread = np.exp(RATE_SPREAD * rng.standard_normal(number.size))
    state[:, 1] *= np.where(waves.grows[of_it], spread, 0.0)
    return WaveDraw((number, np.concatenate(places)), state, waves.omega[of_it])


def wave_lives(sample: WaveDraw, cells: Cells) -> NDArray[np.float64]:
    """Return hours until each sample first reaches its limit [h], ``(m,)``."""
    limits = cells.limit[cells.slices["constant"]][sample.at[0]]
    # Towards the side to which it grows; a component of one side does not shrink to its limit.
    two_sided = np.bincount(cells.component, cells.side < 0.0)[sample.at[0]] > 0.0
    side = np.where(two_sided & (sample.state[:, 1] < 0.0), -1.0, 1.0)
    return _first_passages(sample.state * side[:, None] / limits[:, None], sample.omega)


@kernel()
def _first_passages(state: NDArray[np.float64], omega: NDArray[np.float64]) -> NDArray[np.float64]:
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
        # Before the level is within the wave of the limit nothing can happen.
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


def wave_values(sample: WaveDraw, hours: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return signed distances from healthy after hours of growth of each [h], ``(k, m)``."""
    x, rate, c, s = sample.state.T
    turn = hours * sample.omega
    return x + rate * hours + c * np.cos(turn) + s * np.sin(turn)
