"""What the growth of units says of the next one: the distribution of curves and rates over a fleet.

Each unit gives, for each fault that grows, the likelihood of its tests under every curve and rate
of the tracker's grid, which is all that they say of both. Whether it failed or still runs does not
matter: a life that has not ended says that it is longer. The distribution over the units is fitted
to these likelihoods by empirical Bayes: expectation maximisation of a mixing distribution (Laird
1978), smoothed over the rates after each step (Silverman, Jones, Wilson and Nychka 1990). Parts of
a fleet are put together by putting their likelihoods together, so that nothing is lost and no test
leaves the site. P26 of docs/prognosis.md.
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS, kind_of
from ema_core.growth_laws import hours_until
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.cells import Cells, grid
from ema_monitor.prognosis.growth.settings import (
    LIFE_HOURS,
    FleetPrior,
    KnownLaw,
    TrackerSettings,
)

N_RATES: Final = 33
_SPACING: Final = float(np.log(LIFE_HOURS[-1] / LIFE_HOURS[0]) / (N_RATES - 1))
"""Rates that are told apart, by the hours from healthy to the limit, and their distance [-]."""
LEAST_LOG: Final = -30.0
"""Logarithm below the highest at which a likelihood is cut off [-]."""
_KEPT: Final = 0.5
"""Share of the prior without a fleet that is kept: the unit may be of another kind [-]."""
_UNITS_OF_CURVES: Final = 4.0
_UNITS_OF_RATES: Final = 2.0
"""Weight of the distribution without a fleet in that of the fleet [units]."""
_SMOOTHING: Final = 0.25
"""Width of the smoothing over the logarithm of the rate [-]."""
_STEPS: Final = 60


class GrownFault(NamedTuple):
    """What the tests of a unit say of the growth of one of its faults.

    Attributes
    ----------
    kind
        Kind of the fault.
    log_likelihood
        Of each curve and rate, 0 for the likeliest, at least ``LEAST_LOG``, ``(curves, rates)``.
    """

    kind: str
    log_likelihood: NDArray[np.float16]


class _Place(NamedTuple):
    """Where the growing cells of a component are among the curves and rates of a fleet.

    Attributes
    ----------
    cells
        The cells, ``(n,)``.
    place
        Of each, number of its curve times ``N_RATES``, plus number of its rate, ``(n,)``.
    curves
        How many curves there are.
    """

    cells: NDArray[np.intp]
    place: NDArray[np.intp]
    curves: int

    def sums(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sums of values of all cells, ``(curves, rates)``."""
        found = np.bincount(self.place, values[self.cells], self.curves * N_RATES)
        return found.reshape(self.curves, N_RATES).astype(np.float64, copy=False)


def _place(cells: Cells, number: int) -> _Place:
    """Return where the growing cells of a component are: either side of healthy is the same."""
    at = np.flatnonzero(cells.component == number)
    law = np.empty(cells.prior.size, dtype=np.intp)
    for n, part in enumerate(cells.slices.values()):
        law[part] = n
    still = cells.slices["constant"]
    at = at[(at < still.start) | (at >= still.stop)]
    hours = np.empty(at.size)
    for n, name in enumerate(cells.slices):
        own = law[at] == n
        one = at[own]
        hours[own] = hours_until(name, 0.0, cells.base[one], cells.shape[one], cells.limit[one])
    rate = np.rint(np.log(hours / LIFE_HOURS[0]) / _SPACING).astype(np.intp)
    figures = np.stack([law[at], cells.shape[at], cells.diffusion[at], cells.wanders[at]])
    curves, curve = np.unique(np.round(figures, 12), axis=1, return_inverse=True)
    index = curve.ravel() * N_RATES + np.clip(rate, 0, N_RATES - 1)
    return _Place(at, index, curves.shape[1])


def grown_faults(
    cells: Cells, weight: NDArray[np.float64], growing: NDArray[np.bool_]
) -> dict[str, GrownFault]:
    """Return what a tracker says of the faults that are seen to grow, by component.

    Parameters
    ----------
    cells
        Its grid.
    weight
        Probability of each cell [-].
    growing
        Which components are judged to grow, ``(7,)``.
    """
    found = {}
    for number in np.flatnonzero(growing):
        name = COMPONENTS[number]
        place = _place(cells, int(number))
        before = place.sums(cells.prior)
        with np.errstate(divide="ignore", invalid="ignore"):
            log = np.log(place.sums(weight) / before)
        log = np.where(before > 0.0, log, -np.inf)
        log = np.maximum(log - log.max(), LEAST_LOG)
        found[name] = GrownFault(kind_of(name), log.astype(np.float16))
    return found


def curves_without_fleet(limits: HealthLimits) -> dict[str, NDArray[np.float64]]:
    """Return the prior of curves and rates by kind of fault, ``(curves, rates)`` each; sums to 1.

    Parameters
    ----------
    limits
        Where lives end.
    """
    cells = grid(limits, TrackerSettings())
    found = {}
    for number, name in enumerate(COMPONENTS):
        share = _place(cells, number).sums(cells.prior)
        found[kind_of(name)] = share / share.sum()
    return found


def with_fleet(cells: Cells, fleet: FleetPrior | None, known: Mapping[str, KnownLaw]) -> Cells:
    """Return a grid whose prior of curves and rates is that of a fleet, where no law is known.

    Parameters
    ----------
    cells
        The grid.
    fleet
        How other units grew; None when that is unknown.
    known
        Laws by component.
    """
    if fleet is None:
        return cells
    prior = cells.prior.copy()
    for number, name in enumerate(COMPONENTS):
        share = fleet.shares.get(kind_of(name))
        if share is None or name in known:
            continue
        place = _place(cells, number)
        before = place.sums(cells.prior)
        if share.shape != before.shape:
            raise ValueError(f"the fleet's {name} has {share.shape} curves, not {before.shape}")
        factor = np.divide(share * before.sum(), before, out=np.zeros_like(share), where=before > 0)
        prior[place.cells] *= factor.ravel()[place.place]
        prior[place.cells] *= before.sum() / prior[place.cells].sum()
    return replace(cells, prior=prior)


def grid_digest(limits: HealthLimits) -> str:
    """Return what tells whether likelihoods are of the same curves and rates."""
    cells = grid(limits, TrackerSettings())
    digest = hashlib.sha256(repr(cells.slices).encode())
    figures = (cells.component, cells.side, cells.base, cells.shape, cells.diffusion, cells.wanders)
    for one in figures:
        digest.update(np.round(np.asarray(one, dtype=np.float64), 12).tobytes())
    return digest.hexdigest()[:16]


def distribution(
    likelihoods: Sequence[NDArray[np.float16]], prior: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distribution of curves and rates over units, ``(curves, rates)``; sums to 1.

    Parameters
    ----------
    likelihoods
        Logarithms of those of each unit, ``(curves, rates)``.
    prior
        The distribution without any unit, ``(curves, rates)``.
    """
    units = np.exp(np.stack(likelihoods), dtype=np.float64) * prior
    of_curves, of_rates = prior.sum(axis=1), prior.sum(axis=0)
    kernel = _kernel(prior.shape[1])
    # How much likelier each curve, and each rate, is in the fleet than without one.
    curves, rates = np.ones_like(of_curves), np.ones_like(of_rates)
    for _ in range(_STEPS):
        on_curves = np.einsum("ucr,r->uc", units, rates) * curves
        on_rates = np.einsum("ucr,c->ur", units, curves) * rates
        total = on_curves.sum(axis=1, keepdims=True)
        count = (on_curves / total).sum(axis=0) + _UNITS_OF_CURVES * of_curves
        curves = np.divide(count, of_curves, out=np.zeros_like(count), where=of_curves > 0.0)
        count = (on_rates / total).sum(axis=0)
        rates = (kernel @ count) / (kernel @ of_rates) + _UNITS_OF_RATES
        curves, rates = curves / (of_curves @ curves), rates / (of_rates @ rates)
    share = prior * curves[:, None] * rates
    return (1.0 - _KEPT) * share / share.sum() + _KEPT * prior


def _kernel(n: int) -> NDArray[np.float64]:
    """Return the weights by which neighbouring rates are taken together, ``(n, n)``."""
    steps = np.arange(n)
    return np.exp(-0.5 * ((steps[:, None] - steps) * _SPACING / _SMOOTHING) ** 2)
