"""The grid over laws, shapes and rates on which a tracker weighs how each component grows.

A rate is stated by the hours T that the law takes from healthy to the limit, and a shape by the
bend that it gives to the curve on the way, so that one grid serves components, limits and
actuators of any kind. Of an unknown law all are equally probable, with any T from 50 h to
30,000 h, log-uniform. These figures come from what a tracker can tell (faster growth ends within
five tests, slower growth is beyond the horizon), not from the lives that it is tried on. Damage
does not slow down and does not heal: shapes bend upwards, and drift with diffusion is a law only
of a component that can leave its healthy value to either side.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import FAULT_NAMES, FAULTS
from ema_core.growth_laws import LAWS, hours_until
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.settings import COMPONENTS, KnownLaw, TrackerSettings

N_RATES: Final = 121
LIFE_HOURS: Final = np.geomspace(50.0, 30_000.0, N_RATES)
"""Hours from healthy to the limit on the grid [h]."""
RATE_SPACING: Final = float(np.log(LIFE_HOURS[1] / LIFE_HOURS[0]))
"""Distance of neighbouring rates in the logarithm [-]."""
CONSTANT_PRIOR: Final = 0.5
"""Prior probability that a component does not grow [-]."""

# Shapes, as multiples of the limit: b L and x_0 / L; p is a number by itself.
_SHAPES: Final = {
    "linear": (0.0,),
    "archard": (0.75, 1.5, 3.0),
    "exponential": (0.25, 0.12, 0.06, 0.03),
    "self_heating": (0.75, 1.5, 3.0),
    "power": (1.25, 1.5, 1.75, 2.0, 2.5, 3.0),
}
# Of drift: diffusion over 1,000 h as multiples of the limit.
_DIFFUSIONS: Final = (0.05, 0.1, 0.2)


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of the grid, ``(n,)`` each, those of a law next to each other.

    Attributes
    ----------
    slices
        Where the cells of each law are.
    component
        Number of the component among those tracked.
    side
        Side of the healthy value on which it grows, -1 or 1.
    rate, shape
        Figures of the law.
    diffusion
        Of ``drift`` its s [1/sqrt(h)]; else 0.
    limit
        Distance from healthy at which life ends [-].
    prior
        Prior probability; sums to 1 over the cells of a component.
    """

    slices: dict[str, slice]
    component: NDArray[np.intp]
    side: NDArray[np.float64]
    rate: NDArray[np.float64]
    shape: NDArray[np.float64]
    diffusion: NDArray[np.float64]
    limit: NDArray[np.float64]
    prior: NDArray[np.float64]


def grid(limits: HealthLimits, settings: TrackerSettings) -> Cells:
    """Return the cells for all components.

    Parameters
    ----------
    limits
        Where life ends.
    settings
        Laws that are known.
    """
    slices: dict[str, slice] = {}
    parts: list[NDArray[np.float64]] = []
    n = 0
    for law in LAWS:
        start = n
        for number, name in enumerate(COMPONENTS):
            part = _cells_of(law, number, limits.of(name), settings.laws.get(name))
            parts.append(part)
            n += part.shape[1]
        slices[law] = slice(start, n)
    component, side, rate, shape, diffusion, limit, prior = np.concatenate(parts, axis=1)
    number = component.astype(np.intp)
    prior /= np.bincount(number, prior)[number]
    return Cells(slices, number, side, rate, shape, diffusion, limit, prior)


def _cells_of(law: str, number: int, limit: float, known: KnownLaw | None) -> NDArray[np.float64]:
    """Return component, side, rate, shape, diffusion, limit and prior, ``(7, n)``."""
    if law == "constant":
        return np.array([[number, 1.0, 0.0, 0.0, 0.0, limit, CONSTANT_PRIOR]]).T
    fault = FAULTS[FAULT_NAMES.index(COMPONENTS[number])]
    sides = (1.0,) if fault.healthy == 0.0 else (-1.0, 1.0)
    possible = known.law == law if known else law != "drift" or len(sides) == 2
    if not possible:
        return np.empty((7, 0))
    share = 1.0 - CONSTANT_PRIOR
    if known is not None:
        figures = [(known.shape, known.diffusion if law == "drift" else 0.0)]
    else:
        figures = _figures(law, limit)
        share /= len(LAWS) - (1 if len(sides) == 2 else 2)
    parts = []
    for shape, diffusion in figures:
        # Hours of the law at rate 1: T is in proportion to 1 / a, and to c.
        at_one = float(hours_until(law, 0.0, 1.0, shape, limit))
        rate = LIFE_HOURS / at_one if law == "power" else at_one / LIFE_HOURS
        prior = _rate_prior(rate, known) * share / (len(figures) * len(sides))
        for side in sides:
            row = np.empty((7, N_RATES))
            row[:] = np.array([[number, side, 0.0, shape, diffusion, limit, 0.0]]).T
            row[2], row[6] = rate, prior
            parts.append(row)
    return np.concatenate(parts, axis=1)


def _figures(law: str, limit: float) -> list[tuple[float, float]]:
    """Return shapes and diffusions."""
    if law == "drift":
        return [(0.0, share * limit / np.sqrt(1000.0)) for share in _DIFFUSIONS]
    if law in ("archard", "self_heating"):
        return [(bend / limit, 0.0) for bend in _SHAPES[law]]
    if law == "exponential":
        return [(bend * limit, 0.0) for bend in _SHAPES[law]]
    return [(shape, 0.0) for shape in _SHAPES[law]]


def _rate_prior(rate: NDArray[np.float64], known: KnownLaw | None) -> NDArray[np.float64]:
    flat = np.full(N_RATES, 1.0 / N_RATES)
    if known is None:
        return flat
    peak = np.exp(-0.5 * (np.log(rate / known.rate) / known.rate_sigma) ** 2)
    return 0.5 * flat + 0.5 * peak / peak.sum()
