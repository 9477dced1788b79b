# SPDX-License-Identifier: Apache-2.0
"""Grid of growth laws, shapes and rates over which a tracker distributes probability (P6).

Rates are parametrized by the hours from healthy to the limit, and shapes by the bend of the curve,
so that the same grid fits all components, limits and laws. Cells have either a steady rate or a
rate that wanders around a nominal value (``wander``).
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.laws import TRACKED_LAWS
from ema_monitor.prognosis.growth.laws.external import External
from ema_monitor.prognosis.growth.laws.interface import Curve, Figures, Law
from ema_monitor.prognosis.growth.mechanisms import MECHANISMS, Mechanisms
from ema_monitor.prognosis.growth.tracker_settings import LIFE_HOURS, KnownLaw, TrackerSettings
from ema_monitor.prognosis.growth.wander import FACTORS, PACES, SHARES

CONSTANT_PRIOR: Final = 0.5
"""Prior probability that a component does not grow [-]."""

N_RATES: Final = 33
"""Number of nominal rates per curve, for wandering rates and fleet priors."""
RATE_SPACING: Final = math.log(LIFE_HOURS[-1] / LIFE_HOURS[0]) / (N_RATES - 1)
"""Spacing of the logarithms of the nominal rates [-]."""

_CONSISTENT: Final = 1e-3
"""Relative tolerance for consistency of the methods of a user-defined law [-]."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of the grid, as columns of shape ``(n,)``; cells of the same law are adjacent."""

    laws: dict[str, Law]
    """Growth laws by name; a user-defined law is listed under its component."""
    slices: dict[str, slice]
    """Range of cells of each law."""
    component: NDArray[np.intp]
    """Component index."""
    side: Array
    """Direction of growth from healthy, -1 or 1."""
    rate: Array
    """Rate of the law, including the pace."""
    shape: Array
    """Second parameter of the law."""
    third: Array
    """Third parameter of the law, see `Curve`."""
    is_random: Flags
    """Whether the law is random by nature (drift or jumps)."""
    limit: Array
    """Distance from healthy at which life ends (limit) [-]."""
    prior: Array
    """Prior probability; sums to 1 over the cells of a component."""
    base: Array
    """Rate without the pace."""
    spacing: Array
    """Spacing of neighbouring rates in the logarithm [-]."""
    wanders: Flags
    """Whether the rate wanders."""
    pace: Array
    """Log-pace [-]; 0 if the rate does not wander."""
    place: NDArray[np.intp]
    """Curve index times ``N_RATES`` plus rate index; -1 for cells without growth."""

    def figures(self, at: slice | NDArray[np.intp]) -> Figures:
        """Return the law parameters of the selected cells."""
        every = self.side, self.rate, self.shape, self.third, self.limit
        return Figures(*(column[at] for column in every))


class Owners:
    """Fast summation of cell values by component, for components whose cells form few runs."""

    def __init__(self, component: NDArray[np.intp]) -> None:
        self._starts = np.flatnonzero(np.diff(component, prepend=-1))
        self._of_runs = component[self._starts]

    def sums(self, values: Array) -> Array:
        """Return the sum of values, ``(n,)``, over the cells of each component, ``(7,)``."""
        sums = np.bincount(self._of_runs, np.add.reduceat(values, self._starts), len(COMPONENTS))
        return sums.astype(np.float64, copy=False)


_KINDS: Final = {"component": np.intp, "place": np.intp, "wanders": bool, "is_random": bool}
_ROW: Final = np.dtype(
    [
        (item.name, _KINDS.get(item.name, np.float64))
        for item in fields(Cells)
        if item.name not in ("laws", "slices")
    ]
)


def grid(
    limits: HealthLimits, settings: TrackerSettings, mechanisms: Mechanisms = MECHANISMS
) -> Cells:
    """Return the grid for the given limits, known laws and growth mechanisms.

    The grid is cached and shared between units, so its columns are read-only.
    """
    return _grid(limits, tuple(settings.laws.items()), mechanisms)


@lru_cache(maxsize=4)
def _grid(
    limits: HealthLimits, laws: tuple[tuple[str, KnownLaw], ...], mechanisms: Mechanisms
) -> Cells:
    known_laws = dict(laws)
    every = dict(TRACKED_LAWS)
    every |= {name: External(law.law) for name, law in laws if not isinstance(law.law, str)}
    by_law = {law: [np.zeros(0, _ROW)] for law in every}
    for number, name in enumerate(COMPONENTS):
        limit, known_law = limits.of(name), known_laws.get(name)
        two_sided = FAULTS[FAULT_NAMES.index(name)].is_two_sided
        still = np.zeros(1, _ROW)
        still["side"], still["prior"], still["place"] = 1.0, CONSTANT_PRIOR, -1
        if known_law:
            grown = _known_blocks(name, known_law, every, limit)
        else:
            grown = _unknown_blocks(limit, mechanisms, two_sided=two_sided)
        for curve_number, (law, rows) in enumerate([("constant", still), *grown], -1):
            rows["component"], rows["limit"] = number, limit
            if law != "constant":
                rows["place"] += N_RATES * curve_number
            if two_sided and law != "constant":
                rows["prior"] /= 2.0
                mirrored = rows.copy()
                mirrored["side"] = -1.0
                by_law[law].append(mirrored)
            by_law[law].append(rows)
    figures = {law: np.concatenate(rows) for law, rows in by_law.items()}
    stops = np.cumsum([0, *(rows.size for rows in figures.values())]).tolist()
    slices = {law: slice(*pair) for law, pair in zip(figures, pairwise(stops), strict=True)}
    rows = np.concatenate([*figures.values()])
    columns = {name: np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ()}
    columns["prior"] /= np.bincount(rows["component"], rows["prior"])[rows["component"]]
    for column in columns.values():
        column.flags.writeable = False
    return Cells(every, slices, **columns)


Block = tuple[
    str, NDArray[np.void]
]  # name of a curve's law, and its cells for growth above healthy


def _known_blocks(
    component: str, prior: KnownLaw, laws: Mapping[str, Law], limit: float
) -> Iterator[Block]:
    """Yield the cells of a component whose law is known."""
    name = prior.law if isinstance(prior.law, str) else component
    law = laws[name]
    if isinstance(law, External):
        _check(component, law, prior.shape, limit)
    third = prior.diffusion if law.is_random else 0.0
    rows = _rows(law, Curve(prior.shape, 1.0, third), limit, LIFE_HOURS)
    away = (np.log(rows["rate"] / prior.rate) / prior.rate_sigma) ** 2
    # If the rate is far outside the grid, the nearest rate gets all the probability.
    peak = np.exp(0.5 * (away.min() - away))
    rows["prior"] = 0.5 * rows["prior"] + 0.5 * (1.0 - CONSTANT_PRIOR) * peak / peak.sum()
    yield name, rows


def _check(component: str, law: External, shape: float, limit: float) -> None:
    """Raise ``ValueError`` if the methods of a user-defined law are inconsistent."""
    once = Figures(*np.array([[1.0], [1.0], [shape], [0.0], [limit]]))
    start, twice = np.zeros(1), once._replace(rate=np.full(1, 2.0))
    hours = law.hours_until(start, once)
    if not (np.all(np.isfinite(hours)) and np.all(hours > 0.0)):
        text = f"hours_until gives {hours} h from 0 to {limit:g} at rate 1: expected more than 0"
    elif not np.allclose(law.hours_until(start, twice), 0.5 * hours, rtol=_CONSISTENT):
        text = "hours_until at rate 2 is not half of hours_until at rate 1"
    elif not np.allclose(law.increment(start, once, hours), limit, rtol=_CONSISTENT):
        text = f"increment from 0 within the hours until {limit:g} is not {limit:g}"
    else:
        return
    raise ValueError(f"law {law} of {component}, shape {shape:g}: {text}")


def _unknown_blocks(limit: float, mechanisms: Mechanisms, *, two_sided: bool) -> Iterator[Block]:
    """Yield the cells of a component whose law is unknown."""
    laws = [TRACKED_LAWS[name] for name in mechanisms.laws]
    laws = [law for law in laws if two_sided or not law.either_side]
    steady = 1.0 - mechanisms.wandering
    curves = [(law, curve) for law in laws if steady for curve in law.curves(limit)]
    total = sum(curve.share for _, curve in curves)
    for law, curve in curves:
        share = curve.share / total / law.copies
        rows = _rows(law, curve, limit, LIFE_HOURS[::2], steady, share)
        yield law.name, np.tile(rows, law.copies)
    lives = np.geomspace(LIFE_HOURS[0], LIFE_HOURS[-1], N_RATES)
    wanders = [law for law in laws if mechanisms.wandering]
    wandering = [(law, Curve(shape)) for law in wanders for shape in law.wandering(limit)]
    for law, curve in wandering:
        rows = _rows(law, curve, limit, lives, mechanisms.wandering, 1.0 / len(wandering))
        rows = np.tile(rows, PACES.size)
        rows["rate"] *= np.repeat(FACTORS, lives.size)
        rows["prior"] *= np.repeat(SHARES, lives.size)
        rows["pace"] = np.repeat(PACES, lives.size)
        rows["wanders"] = True
        yield law.name, rows


def _rows(
    law: Law, curve: Curve, limit: float, lives: Array, kind: float = 1.0, share: float = 1.0
) -> NDArray[np.void]:
    """Return the cells of a curve: one cell per life in ``lives`` [h], with equal priors.

    Their priors sum to ``kind * (1 - CONSTANT_PRIOR) * share``.
    """
    rows = np.zeros(lives.size, _ROW)
    # Hours to the limit at rate 1; they are proportional to 1 / a, or to c for law power.
    figures = np.array([1.0, 1.0, curve.shape, curve.third, limit])
    at_one = float(law.hours_until(np.zeros(1), Figures(*figures[:, None]))[0])
    rate = lives / at_one if law.has_time_scale else at_one / lives
    rows["side"], rows["rate"], rows["base"] = 1.0, rate, rate
    rows["shape"], rows["third"], rows["is_random"] = curve.shape, curve.third, law.is_random
    rows["spacing"] = math.log(lives[1] / lives[0])
    rows["prior"] = np.full(lives.size, 1.0 / lives.size) * kind * (1.0 - CONSTANT_PRIOR) * share
    rows["place"] = np.rint(np.log(lives / lives[0]) / RATE_SPACING)
    return rows
