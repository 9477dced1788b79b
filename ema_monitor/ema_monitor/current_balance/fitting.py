"""Weighted least squares of several balances at once, with a prior and robust errors (M41)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_monitor.current_balance.balance import Balance

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

    mean: NDArray[np.float64]
    sigma: NDArray[np.float64]
    loads: NDArray[np.float64]
    load_sigmas: NDArray[np.float64]


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
    rows
        Number of rows that count.
    cost
        Sum of the weighted squares of what is left, times the time of a row [A^2.s].
    """

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    loads: NDArray[np.float64]
    load_covariances: NDArray[np.float64]
    rms: float
    rms_before: float
    rows: int
    cost: float

    @property
    def sigma(self) -> NDArray[np.float64]:
        """Standard deviations of the terms."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def fit(
    balances: Sequence[Balance], prior: BalancePrior, fitted: NDArray[np.bool_], noise: float
) -> Fit:
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
    robust = [np.ones(len(one)) for one in balances]
    scale = max(noise, 1e-9)
    solved = _solved(balances, prior, chosen, robust, scale)
    for _ in range(_PASSES):
        counted = [r[one.weight > 0.0] for r, one in zip(solved.left, balances, strict=True)]
        spread = 1.4826 * float(np.median(np.abs(np.concatenate(counted))))
        beyond = _HUBER * max(spread, 0.3 * scale)
        robust = [1.0 / np.maximum(1.0, np.abs(r) / beyond) for r in solved.left]
        solved = _solved(balances, prior, chosen, robust, scale)
    parts, inverse, step, left = solved
    meat = sum(
        _long_run(part.design * r[:, None], one.step_s)
        for part, r, one in zip(parts, left, balances, strict=True)
    )
    meat = meat + np.diag((scale**2 / prior.sigma[chosen]) ** 2)
    values = prior.mean.copy()
    values[chosen] += step
    covariance = np.zeros((len(values), len(values)))
    covariance[np.ix_(chosen, chosen)] = inverse @ meat @ inverse
    rows = sum(int(np.count_nonzero(one.weight)) for one in balances)
    power = sum(float(r @ r) for r in left)
    total = max(sum(float(np.sum(one.weight**2)) for one in balances), 1e-12)
    loads = [part.loads_after(step, covariance[np.ix_(chosen, chosen)], scale) for part in parts]
    return Fit(
        values,
        covariance,
        np.array([mean for mean, _ in loads]),
        np.array([spread for _, spread in loads]),
        float(np.sqrt(power / total)),
        float(np.sqrt(sum(float(part.left @ part.left) for part in parts) / total)),
        rows,
        sum(float(r @ r) * one.step_s for r, one in zip(left, balances, strict=True)),
    )


class _Solved(NamedTuple):
    """Optimum with some weights: inverse of the normal matrix, step, and what it leaves."""

    parts: list["_Part"]
    inverse: NDArray[np.float64]
    step: NDArray[np.float64]
    left: list[NDArray[np.float64]]


def _solved(
    balances: Sequence[Balance],
    prior: BalancePrior,
    chosen: NDArray[np.int64],
    robust: Sequence[NDArray[np.float64]],
    scale: float,
) -> _Solved:
    parts = [
        _Part(one, prior, number, chosen, weight, scale)
        for number, (one, weight) in enumerate(zip(balances, robust, strict=True))
    ]
    normal = np.diag((scale / prior.sigma[chosen]) ** 2)
    normal += sum(part.design.T @ part.design for part in parts)
    size = np.sqrt(np.diag(normal))
    inverse = np.linalg.inv(normal / np.outer(size, size)) / np.outer(size, size)
    step = inverse @ sum(part.design.T @ part.left for part in parts)
    return _Solved(parts, inverse, step, [part.left - part.design @ step for part in parts])


class _Part:
    """One balance without its load and stiffness, about the mean of the prior."""

    def __init__(
        self,
        balance: Balance,
        prior: BalancePrior,
        number: int,
        chosen: NDArray[np.int64],
        robust: NDArray[np.float64],
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

    def loads_after(
        self, step: NDArray[np.float64], covariance: NDArray[np.float64], scale: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return load and stiffness with their covariance."""
        mean = self._mean + self._of_left - self._of_rows @ step
        return mean, scale**2 * self._inverse + self._of_rows @ covariance @ self._of_rows.T


def _long_run(scores: NDArray[np.float64], step_s: float) -> NDArray[np.float64]:
    """Return the long-run covariance of the sum of scores, ``(n, d)``, after Newey and West."""
    lags = max(_FEWEST_LAGS, round(_LAG_S / step_s))
    total = scores.T @ scores
    for lag in range(1, min(lags, len(scores) - 1) + 1):
        shifted = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (shifted + shifted.T)
    return total
