"""Weighted least squares of several balances at once, with a prior and robust errors (M41)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_core.arrays import Array, Flags
from ema_core.parameters import ActuatorParameters
from ema_monitor.current_balance.balance import BASIC, Balance, Ripple
from ema_monitor.windows.window import Window

EVIDENT: Final = 36.0
"""Squared distance from the healthy one, in its covariance, from which on a ripple is there."""

_LOAD: Final = 0.2
_WORTHWHILE: Final = 0.1
_LAG_S: Final = 8e-3
_FEWEST_LAGS: Final = 2
_HUBER: Final = 3.0
_PASSES: Final = 3


@dataclass(frozen=True, eq=False)
class BalancePrior:
    """What is known of the terms before a motion, and of its loads.

    Attributes
    ----------
    mean, sigma
        Of each term, ``(terms,)``.
    loads, load_sigmas
        Mean and sigma of load [A] and stiffness [A/rad] for each balance, ``(balances, 2)``.
    """

    mean: Array
    sigma: Array
    loads: Array
    load_sigmas: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """What explains balances.

    Attributes
    ----------
    values, covariance
        Of the terms that were fitted; others are at the mean of their prior, with variance 0.
    loads, load_covariances
        Load [A] and stiffness [A/rad] of each balance, ``(balances, 2)`` and ``(balances, 2, 2)``.
    rms, rms_before
        Weighted rms of what is left, and of what the prior's mean leaves but for loads [A].
    cost
        Sum of the weighted squares of what is left, times the time of a row [A^2.s].
    """

    values: Array
    covariance: Array
    loads: Array
    load_covariances: Array
    rms: float
    rms_before: float
    cost: float

    @property
    def sigma(self) -> Array:
        """Standard deviations of the terms."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def loads_before(
    windows: Sequence[Window],
    balances: Sequence[Balance],
    parameters: ActuatorParameters,
    healthy: tuple[float, float] = (0.0, 0.0),
) -> tuple[Array, Array]:
    """Return what is known of load [A] and stiffness [A/rad] before: means and sigmas.

    A fifth of the largest current is usual beside those of the healthy unit. What was measured
    beside a window is a torque: the described torque constant makes amperes of it.
    """
    strongest = max(float(np.max(np.abs(one.current), initial=0.0)) for one in balances)
    usual = max(_LOAD * parameters.I_max, strongest)
    means, sigmas = [], []
    for window, one in zip(windows, balances, strict=True):
        known = {cause.name: cause for cause in window.measured}
        mean, sigma = list(healthy), [usual, usual / max(one.travel, 1e-9)]
        for at, name in enumerate(("load_torque", "load_stiffness")):
            if name in known:
                mean[at] += known[name].value / parameters.k_t
                sigma[at] = min(known[name].sigma / parameters.k_t, sigma[at])
        means.append(mean)
        sigmas.append(sigma)
    return np.array(means), np.array(sigmas)


def basic_terms(prior: BalancePrior) -> Flags:
    """Return which terms are basic ones, ``(terms,)``."""
    return np.arange(len(prior.mean)) < len(BASIC)


def fit(balances: Sequence[Balance], prior: BalancePrior, fitted: Flags, noise: float) -> Fit:
    """Fit terms to balances; load and stiffness of each balance are fitted too.

    Parameters
    ----------
    balances
        At least one.
    prior
        What is known before.
    fitted
        Which terms are fitted, ``(terms,)``; the others keep the mean of their prior.
    noise
        Rms of what is left of a healthy motion [A]; it weighs the prior.
    """
    chosen = np.flatnonzero(fitted)
    scale = max(noise, 1e-9)

    def solved(robust: list[Array]) -> tuple[Any, ...]:
        """Return the optimum with some weights: parts, inverse, step and what it leaves."""
        parts = [
            _Part(one, prior, number, chosen, weight, scale)
            for number, (one, weight) in enumerate(zip(balances, robust, strict=True))
        ]
        normal = np.diag((scale / prior.sigma[chosen]) ** 2)
        normal += sum(part.design.T @ part.design for part in parts)
        size = np.sqrt(np.diag(normal))
        inverse = np.linalg.inv(normal / np.outer(size, size)) / np.outer(size, size)
        step = inverse @ sum(part.design.T @ part.left for part in parts)
        return parts, inverse, step, [part.left - part.design @ step for part in parts]

    parts, inverse, step, left = solved([np.ones(len(one.current)) for one in balances])
    for _ in range(_PASSES):
        counted = [r[one.weight > 0.0] for r, one in zip(left, balances, strict=True)]
        spread = 1.4826 * float(np.median(np.abs(np.concatenate(counted))))
        beyond = _HUBER * max(spread, 0.3 * scale)
        parts, inverse, step, left = solved(
            [1.0 / np.maximum(1.0, np.abs(r) / beyond) for r in left]
        )
    meat = sum(
        _long_run(part.design * r[:, None], one.step_s)
        for part, r, one in zip(parts, left, balances, strict=True)
    )
    meat = meat + np.diag((scale**2 / prior.sigma[chosen]) ** 2)
    values = prior.mean.copy()
    values[chosen] += step
    covariance = np.zeros((len(values), len(values)))
    covariance[np.ix_(chosen, chosen)] = of_chosen = inverse @ meat @ inverse
    power = sum(float(r @ r) for r in left)
    total = max(sum(float(np.sum(one.weight**2)) for one in balances), 1e-12)
    loads, load_covariances = zip(
        *(part.loads_after(step, of_chosen, scale) for part in parts), strict=True
    )
    return Fit(
        values,
        covariance,
        np.array(loads),
        np.array(load_covariances),
        float(np.sqrt(power / total)),
        float(np.sqrt(sum(float(part.left @ part.left) for part in parts) / total)),
        sum(float(r @ r) * one.step_s for r, one in zip(left, balances, strict=True)),
    )


def fit_with_ripples(
    balances: Sequence[Balance], prior: BalancePrior, noise: float, ripples: Sequence[Ripple]
) -> Fit:
    """Fit the basic terms and, one after the other, the ripples that are evident (M43)."""
    fitted = basic_terms(prior)
    best, left = fit(balances, prior, fitted, noise), list(ripples)
    while left:
        tried = []
        for ripple in left:
            more = fitted.copy()
            more[ripple.terms] = True
            one = fit(balances, prior, more, noise)
            tried.append((evidence(one, prior, ripple), ripple, more, one))
        strength, ripple, more, one = max(tried, key=lambda item: item[0])
        if strength < EVIDENT or one.cost > (1.0 - _WORTHWHILE) * best.cost:
            break
        fitted, best = more, one
        left.remove(ripple)
    return best


def evidence(found: Fit, prior: BalancePrior, ripple: Ripple) -> float:
    """Return the squared distance of a ripple from the mean of its prior."""
    change = found.values[ripple.terms] - prior.mean[ripple.terms]
    covariance = found.covariance[ripple.terms, ripple.terms]
    return float(change @ np.linalg.solve(covariance, change)) if np.any(covariance) else 0.0


class _Part:
    """One balance without its load and stiffness, about the mean of the prior."""

    def __init__(
        self,
        balance: Balance,
        prior: BalancePrior,
        number: int,
        chosen: NDArray[np.int64],
        robust: Array,
        scale: float,
    ) -> None:
        weight = balance.weight * np.sqrt(robust)
        self._mean = prior.loads[number]
        nuisance = balance.nuisance * weight[:, None]
        rows = balance.design[:, chosen] * weight[:, None]
        left = weight * (
            balance.current - balance.design @ prior.mean - balance.nuisance @ self._mean
        )
        ridge = np.diag((scale / prior.load_sigmas[number]) ** 2)
        self._inverse = np.linalg.inv(nuisance.T @ nuisance + ridge)
        # Both without what load and stiffness explain of them.
        self._of_rows = self._inverse @ nuisance.T @ rows
        self._of_left = self._inverse @ nuisance.T @ left
        self.design = rows - nuisance @ self._of_rows
        self.left = left - nuisance @ self._of_left

    def loads_after(self, step: Array, covariance: Array, scale: float) -> tuple[Array, Array]:
        """Return load and stiffness with their covariance."""
        mean = self._mean + self._of_left - self._of_rows @ step
        return mean, scale**2 * self._inverse + self._of_rows @ covariance @ self._of_rows.T


def _long_run(scores: Array, step_s: float) -> Array:
    """Return the long-run covariance of the sum of scores, ``(n, d)``, after Newey and West."""
    lags = max(_FEWEST_LAGS, round(_LAG_S / step_s))
    total = scores.T @ scores
    for lag in range(1, min(lags, len(scores) - 1) + 1):
        shifted = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (shifted + shifted.T)
    return total
