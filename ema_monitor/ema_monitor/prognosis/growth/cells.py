"""The grid over laws, shapes and rates on which a tracker weighs how each component grows.

A rate is stated by the hours T of the law from healthy to the limit, and a shape by the
bend of its curve, so that one grid serves components, limits and actuators of any kind. T is
anything from 50 h to 30,000 h, log-uniform. These figures come from what a tracker can
distinguish (faster growth ends within five tests, slower growth is beyond the horizon), not from
the lives that it is tested on.

Laws bend their curves in ways of their own, so their second figures cannot be compared. The bend
can: the speed of growth at the limit over the mean speed on the way there, 1 for a straight line.
Where no law is known, one grid of bends serves all of them, and every curve is as probable as any
other. Bends of steady growth are above 1.

Growth seldom keeps to one law for life. Beside cells of a steady rate there are those whose rate
wanders about that of a law (``wander``): by the pace, a factor that forgets itself within some
hundred hours. They follow what no law of the grid describes: load, lubrication, what slows down.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_core.growth_laws import LAWS, hours_until
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.settings import LIFE_HOURS, KnownLaw, TrackerSettings
from ema_monitor.prognosis.growth.wander import FACTORS, PACES, SHARES

BENDS: Final = tuple(np.geomspace(1.15, 6.0, 12).tolist())
"""Bends of curves of unknown law [-].

The weakest hardly differs from a line; along the strongest half of the way is made in the last
fifth to tenth of life. Neighbours are so close that where a fault's own bend lies between them
does not show in a prediction.
"""

JUMPS: Final = (12.0, 35.0, 100.0)
"""Jumps of a mean size from healthy to the limit, of growth by jumps [-]."""

JUMPING: Final = "jumps"
"""Name of growth by jumps, whose mean is a line."""

_MILD: Final = 4.0
"""Product of b and the limit up to which the curves that two laws share go by ``archard`` [-]."""

# Of drift: diffusion over 1,000 h as multiples of the limit.
_DIFFUSIONS: Final = (0.05, 0.1, 0.2)


CONSTANT_PRIOR: Final = 0.5
"""Prior probability that a component does not grow [-]."""
WANDERING_PRIOR: Final = 0.7
"""Prior probability that the rate of a component that grows wanders, its law unknown [-]."""

N_RATES: Final = 33
"""Rates of a curve about which a rate wanders, and those that a fleet tells apart."""
RATE_SPACING: Final = math.log(LIFE_HOURS[-1] / LIFE_HOURS[0]) / (N_RATES - 1)
"""Distance of these rates in the logarithm [-]."""

_BENDS_OF_WEAR: Final = (4.0,)
_BENDS_OF_HEAT: Final = (2.0, 3.0, 4.5, 6.0, 9.0, 14.0)
_SETTLING: Final = 0.7
"""Share of its first speed that growth which slows down has lost at the limit [-]."""


class Curve(NamedTuple):
    """A law with its second figures: its shape, of ``drift`` its diffusion, and its prior.

    With ``jumps`` above 0 it is a compound Poisson process: so many jumps, of an exponential
    distribution, take it to the limit on average (Lawless and Crowder 2004).
    """

    law: str
    shape: float
    diffusion: float
    share: float
    jumps: float = 0.0


def curves_of(limit: float, known: KnownLaw | None, *, two_sided: bool) -> list[Curve]:
    """Return the curves that a component may follow.

    Parameters
    ----------
    limit
        Distance from healthy at which its life ends [-].
    known
        Its law, if that is known.
    two_sided
        Whether it can leave its healthy value to either side: such a component may drift too.
    """
    if known is not None:
        diffusion = known.diffusion if known.law == "drift" else 0.0
        return [Curve(known.law, known.shape, diffusion, 1.0)]
    curves = [Curve("linear", 0.0, 0.0, 1.0)]
    for bend in BENDS:
        worn, heated = _root(_bend_of_wear, bend), _root(_bend_of_heat, bend)
        # dx/du = a (1 + b x) and a (x + x_0) are the same curves, with x_0 = 1 / b.
        if worn <= _MILD:
            curves.append(Curve("archard", worn / limit, 0.0, 1.0))
        else:
            curves.append(Curve("exponential", limit / worn, 0.0, 1.0))
        curves.append(Curve("self_heating", heated / limit, 0.0, 1.0))
        curves.append(Curve("power", bend, 0.0, 1.0))
    # As probable as any other law with all its bends.
    curves += [Curve("linear", 0.0, 0.0, len(BENDS) / len(JUMPS), jumps) for jumps in JUMPS]
    if two_sided:
        share = len(BENDS) / len(_DIFFUSIONS)
        spreads = [multiple * limit / math.sqrt(1000.0) for multiple in _DIFFUSIONS]
        curves += [Curve("drift", 0.0, spread, share) for spread in spreads]
    total = sum(curve.share for curve in curves)
    return [curve._replace(share=curve.share / total) for curve in curves]


def wandering_curves(limit: float) -> list[Curve]:
    """Return the curves about which a rate may wander.

    Few, for a wandering rate bends them further, and most of them steep: growth that will
    accelerate must be thought of before it does.
    """
    figures = [("linear", 0.0), ("archard", -_SETTLING / limit)]
    figures += [("archard", _root(_bend_of_wear, bend) / limit) for bend in _BENDS_OF_WEAR]
    figures += [("self_heating", _root(_bend_of_heat, bend) / limit) for bend in _BENDS_OF_HEAT]
    return [Curve(law, shape, 0.0, 1.0 / len(figures)) for law, shape in figures]


def _bend_of_wear(product: float) -> float:
    """Return the bend of dx/du = a (1 + b x) by b times the limit."""
    return (1.0 + product) * math.log1p(product) / product


def _bend_of_heat(product: float) -> float:
    """Return the bend of dx/du = a exp(b x) by b times the limit."""
    return math.expm1(product) / product


def _root(bend_of: Callable[[float], float], bend: float) -> float:
    """Return where an ascending function reaches a bend, by bisection."""
    low, high = 1e-3, 500.0
    while high > low * (1.0 + 1e-12):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if bend_of(middle) < bend else (low, middle)
    return low


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of the grid, ``(n,)`` each, those of a law next to each other."""

    slices: dict[str, slice]  # where the cells of each law are
    component: NDArray[np.intp]  # number of the component among those tracked
    side: Array  # of healthy, on which it grows, -1 or 1
    rate: Array  # of the law now, its pace included
    shape: Array
    diffusion: Array  # of drift its s [1/sqrt(h)]; else 0
    jump: Array  # mean size of a jump [-]; 0 where growth has none
    limit: Array  # distance from healthy at which life ends [-]
    prior: Array  # sums to 1 over the cells of a component
    base: Array  # the rate without its pace
    spacing: Array  # of neighbouring rates in the logarithm [-]
    wanders: Flags
    pace: Array  # its logarithm [-], 0 where the rate does not wander
    place: NDArray[np.intp]  # N_RATES times the number of the curve, plus that of the rate; or -1


class Owners:
    """The components of cells, by which values are summed; cells of one lie in few runs."""

    def __init__(self, component: NDArray[np.intp]) -> None:
        self._starts = np.flatnonzero(np.diff(component, prepend=-1))
        self._of_runs = component[self._starts]

    def sums(self, values: Array) -> Array:
        """Return the sums of values over each component, ``(7,)``."""
        sums = np.bincount(self._of_runs, np.add.reduceat(values, self._starts), len(COMPONENTS))
        return sums.astype(np.float64, copy=False)


_KINDS: Final = {"component": np.intp, "place": np.intp, "wanders": np.bool_}
_ROW: Final = np.dtype(
    [(one.name, _KINDS.get(one.name, np.float64)) for one in fields(Cells) if one.name != "slices"]
)


def grid(limits: HealthLimits, settings: TrackerSettings) -> Cells:
    """Return the cells for all components, by their limits and by the laws that are known."""
    by_law = {law: [np.zeros(0, _ROW)] for law in (*LAWS, JUMPING)}
    lives = np.geomspace(LIFE_HOURS[0], LIFE_HOURS[-1], N_RATES)
    for number, name in enumerate(COMPONENTS):
        limit, known = limits.of(name), settings.laws.get(name)
        two_sided = FAULTS[FAULT_NAMES.index(name)].is_two_sided
        still = np.zeros(1, _ROW)
        still["side"], still["prior"], still["place"] = 1.0, CONSTANT_PRIOR, -1
        blocks = [("constant", still)]
        for curve in curves_of(limit, known, two_sided=two_sided):
            steady = 1.0 if known else 1.0 - WANDERING_PRIOR
            rows = _rows(curve, limit, LIFE_HOURS if known else LIFE_HOURS[::2], known, steady)
            # Of growth by jumps there are cells without a jump since the latest test, and with one.
            if curve.jumps:
                rows["prior"] /= 2.0
                rows = np.tile(rows, 2)
            blocks.append((JUMPING if curve.jumps else curve.law, rows))
        for curve in [] if known else wandering_curves(limit):
            rows = np.tile(_rows(curve, limit, lives, None, WANDERING_PRIOR), PACES.size)
            rows["rate"] *= np.repeat(FACTORS, lives.size)
            rows["prior"] *= np.repeat(SHARES, lives.size)
            rows["pace"] = np.repeat(PACES, lives.size)
            rows["wanders"] = True
            blocks.append((curve.law, rows))
        for curve_number, (law, rows) in enumerate(blocks, -1):
            rows["component"], rows["limit"] = number, limit
            if law != "constant":
                rows["place"] += N_RATES * curve_number
            if two_sided and law != "constant":
                rows["prior"] /= 2.0
                other = rows.copy()
                other["side"] = -1.0
                by_law[law].append(other)
            by_law[law].append(rows)
    found = {law: np.concatenate(rows) for law, rows in by_law.items()}
    stops = np.cumsum([0, *(rows.size for rows in found.values())]).tolist()
    slices = {law: slice(*pair) for law, pair in zip(found, pairwise(stops), strict=True)}
    rows = np.concatenate([*found.values()])
    columns = {name: np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ()}
    columns["prior"] /= np.bincount(rows["component"], rows["prior"])[rows["component"]]
    return Cells(slices, **columns)


def _rows(
    curve: Curve, limit: float, lives: Array, known: KnownLaw | None, share: float
) -> NDArray[np.void]:
    """Return cells of a curve on the upper side, for some hours from healthy to the limit [h]."""
    rows = np.zeros(lives.size, _ROW)
    # Hours of the law at rate 1: T is in proportion to 1 / a, and to c.
    at_one = float(hours_until(curve.law, 0.0, 1.0, curve.shape, limit))
    rate = lives / at_one if curve.law == "power" else at_one / lives
    rows["side"], rows["rate"], rows["base"] = 1.0, rate, rate
    rows["shape"], rows["diffusion"] = curve.shape, curve.diffusion
    if curve.jumps:
        rows["jump"] = limit / curve.jumps
    rows["spacing"] = math.log(lives[1] / lives[0])
    rows["prior"] = _rate_prior(rate, known) * share * (1.0 - CONSTANT_PRIOR) * curve.share
    rows["place"] = np.rint(np.log(lives / lives[0]) / RATE_SPACING)
    return rows


def _rate_prior(rate: Array, known: KnownLaw | None) -> Array:
    flat = np.full(rate.size, 1.0 / rate.size)
    if known is None:
        return flat
    away = (np.log(rate / known.rate) / known.rate_sigma) ** 2
    # Of a rate far off the grid, the nearest is left.
    peak = np.exp(0.5 * (away.min() - away))
    return 0.5 * flat + 0.5 * peak / peak.sum()
