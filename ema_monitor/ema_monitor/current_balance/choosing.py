"""Which torques that repeat with the angle a motion shows (M43)."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_monitor.current_balance.balance import Balance
from ema_monitor.current_balance.fitting import BalancePrior, Fit, fit
from ema_monitor.current_balance.terms import Ripple, columns_of

EVIDENT: Final = 36.0
"""Squared distance from the healthy one, in its covariance, from which on a ripple is there."""

_WORTHWHILE: Final = 0.1


def chosen_ripples(
    balances: Sequence[Balance],
    prior: BalancePrior,
    basic: NDArray[np.bool_],
    noise: float,
    groups: tuple[Ripple, ...],
) -> Fit:
    """Fit the basic terms and, one after the other, the ripples that are evident.

    Parameters
    ----------
    balances, prior, noise
        As of `fit`.
    basic
        Which terms are fitted in any case.
    groups
        The ripples that there may be.
    """
    where = columns_of(groups)
    fitted, best = basic, fit(balances, prior, basic, noise)
    left = list(groups)
    while left:
        tried = []
        for group in left:
            more = fitted.copy()
            more[where[group.name]] = True
            one = fit(balances, prior, more, noise)
            tried.append((evidence(one, prior, where[group.name]), group, more, one))
        strength, group, more, one = max(tried, key=lambda item: item[0])
        if strength < EVIDENT or one.cost > (1.0 - _WORTHWHILE) * best.cost:
            break
        fitted, best = more, one
        left.remove(group)
    return best


def evidence(found: Fit, prior: BalancePrior, where: slice) -> float:
    """Return the squared distance of some terms from the mean of their prior."""
    change = found.values[where] - prior.mean[where]
    covariance = found.covariance[where, where]
    if not np.any(covariance):
        return 0.0
    return float(change @ np.linalg.solve(covariance, change))
