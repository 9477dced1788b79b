"""The curves along which a fault may grow from healthy to its limit, and how probable each is.

Laws bend their curves in ways of their own, so their second figures cannot be compared. What can
is the bend: the speed of growth at the limit over the mean speed on the way there, 1 for a
straight line. Where no law is known, one grid of bends serves all of them, and every curve is as
probable as any other. Damage does not slow down and does not heal, so bends are above 1.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from ema_monitor.prognosis.growth.settings import KnownLaw

BENDS: Final = tuple(np.geomspace(1.15, 6.0, 12).tolist())
"""Bends of curves of unknown law [-].

The weakest hardly differs from a line; along the strongest half of the way is made in the last
fifth to tenth of life. Neighbours are so close that where a fault's own bend lies between them
does not show in a prediction.
"""

_MILD: Final = 4.0
"""Product of b and the limit up to which the curves that two laws share go by ``archard`` [-]."""

# Of drift: diffusion over 1,000 h as multiples of the limit.
_DIFFUSIONS: Final = (0.05, 0.1, 0.2)


@dataclass(frozen=True)
class Curve:
    """A law with its second figures.

    Attributes
    ----------
    law
        One of ``ema_core.growth_laws.LAWS`` but ``constant``.
    shape
        Second figure of the law [-].
    diffusion
        Of ``drift`` its s [1/sqrt(h)]; else 0.
    share
        Its prior probability among all curves [-].
    """

    law: str
    shape: float
    diffusion: float
    share: float


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
    figures = [("linear", 0.0, 0.0, 1.0)]
    for bend in BENDS:
        worn, heated = _root(_bend_of_wear, bend), _root(_bend_of_heat, bend)
        # dx/du = a (1 + b x) and a (x + x_0) are the same curves, with x_0 = 1 / b.
        if worn <= _MILD:
            figures.append(("archard", worn / limit, 0.0, 1.0))
        else:
            figures.append(("exponential", limit / worn, 0.0, 1.0))
        figures.append(("self_heating", heated / limit, 0.0, 1.0))
        figures.append(("power", bend, 0.0, 1.0))
    if two_sided:
        # As probable as any other law with all its bends.
        share = len(BENDS) / len(_DIFFUSIONS)
        spreads = [multiple * limit / np.sqrt(1000.0) for multiple in _DIFFUSIONS]
        figures += [("drift", 0.0, float(spread), share) for spread in spreads]
    total = sum(share for *_, share in figures)
    return [Curve(law, shape, spread, share / total) for law, shape, spread, share in figures]


def _bend_of_wear(product: float) -> float:
    """Return the bend of dx/du = a (1 + b x) by b times the limit."""
    return float((1.0 + product) * np.log1p(product) / product)


def _bend_of_heat(product: float) -> float:
    """Return the bend of dx/du = a exp(b x) by b times the limit."""
    return float(np.expm1(product) / product)


def _root(bend_of: Callable[[float], float], bend: float) -> float:
    """Return where an ascending function takes a bend, by bisection."""
    low, high = 1e-3, 500.0
    while high > low * (1.0 + 1e-12):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if bend_of(middle) < bend else (low, middle)
    return float(low)
