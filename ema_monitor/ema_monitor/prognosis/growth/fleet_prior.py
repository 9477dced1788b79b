# SPDX-License-Identifier: Apache-2.0
"""Prior of the growth curves and rates of a unit, learnt from a fleet (P26).

Each unit contributes, for each growing fault, the likelihood of its tests under every curve and
rate of the grid. The fleet distribution is fitted to these by empirical Bayes (Laird 1978), with
smoothing over the rates (Silverman et al. 1990). Only the likelihoods leave a site.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS, kind_of
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.cells import N_RATES, RATE_SPACING, Cells, grid
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings

LEAST_LOG: Final = -30.0
"""Lower bound of log-likelihoods relative to the maximum [-]."""
_KEPT: Final = 0.8
"""Weight of the fleet-independent prior [-]: the unit may differ from the fleet."""
_UNITS_OF_CURVES: Final = 4.0
_UNITS_OF_RATES: Final = 2.0
"""Equivalent number of units by which the fleet-independent prior is weighted."""
_SMOOTHING: Final = 0.25
"""Smoothing width in the logarithm of the rate [-]."""
_STEPS: Final = 60


class GrownFault(NamedTuple):
    """Evidence from a unit's tests about the growth of one fault."""

    kind: str
    """Kind of the fault."""
    log_likelihood: NDArray[np.float16]
    """Log-likelihood relative to the maximum, ``(curves, rates)``; at least ``LEAST_LOG``."""


def _table(cells: Cells, number: int, values: Array) -> Array:
    """Return the sums of a component's growing cells by curve and rate, ``(curves, rates)``."""
    at = np.flatnonzero((cells.component == number) & (cells.place >= 0))
    sums = np.bincount(cells.place[at], values[at]).astype(np.float64, copy=False)
    return sums.reshape(-1, N_RATES)


def grown_faults(cells: Cells, weight: Array, growing: Flags) -> dict[str, GrownFault]:
    """Return the evidence about each growing fault, by component.

    Parameters
    ----------
    cells, weight
        Grid of the tracker, and probability of each cell, ``(n,)`` [-].
    growing
        Components considered growing, ``(7,)``.
    """
    grown = {}
    for number in np.flatnonzero(growing).tolist():
        before = _table(cells, number, cells.prior)
        with np.errstate(divide="ignore", invalid="ignore"):
            log = np.log(_table(cells, number, weight) / before)
        log = np.where(before > 0.0, log, -np.inf)
        log = np.maximum(log - log.max(), LEAST_LOG)
        name = COMPONENTS[number]
        grown[name] = GrownFault(kind_of(name), log.astype(np.float16))
    return grown


def curves_without_fleet(limits: HealthLimits) -> dict[str, Array]:
    """Return the fleet-independent prior of each kind, ``(curves, rates)``; each sums to 1."""
    cells = grid(limits, TrackerSettings())
    tables = {kind_of(name): _table(cells, n, cells.prior) for n, name in enumerate(COMPONENTS)}
    return {kind: table / table.sum() for kind, table in tables.items()}


def with_fleet(cells: Cells, settings: TrackerSettings) -> Cells:
    """Return the grid with the fleet prior applied to faults of unknown law."""
    prior, shares = cells.prior.copy(), settings.fleet.shares if settings.fleet else {}
    for number, name in enumerate(COMPONENTS):
        share = shares.get(kind_of(name))
        if share is None or name in settings.laws:
            continue
        before = _table(cells, number, cells.prior)
        if share.shape != before.shape:
            raise ValueError(
                f"the fleet prior of {name} has shape {share.shape}, expected {before.shape}"
            )
        factor = np.divide(share * before.sum(), before, out=np.zeros_like(share), where=before > 0)
        at = np.flatnonzero((cells.component == number) & (cells.place >= 0))
        prior[at] *= factor.ravel()[cells.place[at]]
        prior[at] *= before.sum() / prior[at].sum()
    return replace(cells, prior=prior)


def grid_digest(limits: HealthLimits) -> str:
    """Return a digest of the grid, which identifies compatible likelihoods."""
    cells = grid(limits, TrackerSettings())
    digest = hashlib.sha256(repr(cells.slices).encode())
    columns = cells.side, cells.base, cells.shape, cells.third
    for column in (cells.component, *columns, cells.place):
        digest.update(np.round(np.asarray(column, dtype=np.float64), 12).tobytes())
    return digest.hexdigest()[:16]


def distribution(likelihoods: Sequence[NDArray[np.float16]], prior: Array) -> Array:
    """Return the fleet's distribution of curves and rates, ``(curves, rates)``; it sums to 1.

    Parameters
    ----------
    likelihoods
        Log-likelihoods of each grown fault of the units, ``(curves, rates)`` each.
    prior
        Fleet-independent prior, ``(curves, rates)``.
    """
    units = np.exp(np.stack(likelihoods), dtype=np.float64) * prior
    of_curves, of_rates = prior.sum(axis=1), prior.sum(axis=0)
    steps = np.arange(of_rates.size)
    # Smoothing kernel over neighbouring rates.
    kernel = np.exp(-0.5 * ((steps[:, None] - steps) * RATE_SPACING / _SMOOTHING) ** 2)
    # Probability ratios, fleet to prior, of each curve and each rate.
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
