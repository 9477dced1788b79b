# SPDX-License-Identifier: Apache-2.0
"""Exact solutions of the laws by which faults grow in service, for arrays of any shape.

u is the service time [h], x >= 0 the distance of a component from its healthy value. ``rate`` is
the rate a [1/h], or the time scale c [h] of ``power``. ``shape`` [-] is x_0 of ``exponential``, b
of ``archard`` and ``self_heating``, and p of ``power`` (P3).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

_LARGEST: Final = 700.0
"""Largest exponent whose exponential is a finite float [-]."""


class _Solution(Protocol):
    """Exact solution of a law. Arguments are as in `increment` and `hours_until`."""

    def increment(self, x: Any, rate: Any, shape: Any, u: Any) -> Any: ...

    def hours(self, x: Any, rate: Any, shape: Any, limit: Any) -> Any: ...


class _Constant:
    """Law without growth: x is constant."""

    def increment(self, x: Any, rate: Any, shape: Any, u: Any) -> Any:
        return np.zeros(np.broadcast(x, rate, shape, u).shape)

    def hours(self, x: Any, rate: Any, shape: Any, limit: Any) -> Any:
        return np.full(np.broadcast(x, rate, shape, limit).shape, np.inf)


class _Linear:
    """Law dx/du = a, which is also the mean of a Wiener process with drift a."""

    def increment(self, x: Any, rate: Any, shape: Any, u: Any) -> Any:
        return rate * u + np.zeros(np.broadcast(x, shape).shape)

    def hours(self, x: Any, rate: Any, shape: Any, limit: Any) -> Any:
        return (limit - x) / rate + np.zeros(shape.shape)


class _Exponential:
    """Law dx/du = a (x + x_0)."""

    def increment(self, x: Any, rate: Any, shape: Any, u: Any) -> Any:
        return (x + shape) * np.expm1(np.minimum(rate * u, _LARGEST))

    def hours(self, x: Any, rate: Any, shape: Any, limit: Any) -> Any:
        return np.log((limit + shape) / (x + shape)) / rate


class _Archard:
    """Law dx/du = a (1 + b x)."""

    def increment(self, x: Any, rate: Any, shape: Any, u: Any) -> Any:
        grown = (1.0 / shape + x) * np.expm1(np.minimum(rate * shape * u, _LARGEST))
        return np.where(shape == 0.0, rate * u, grown)

    def hours(self, x: Any, rate: Any, shape: Any, limit: Any) -> Any:
        bent = np.log1p(shape * (limit - x) / (1.0 + shape * x)) / (rate * shape)
        return np.where(shape == 0.0, (limit - x) / rate, bent)


class _SelfHeating:
    """Law dx/du = a exp(b x). From x, it diverges after the time 1 / (a b exp(b x))."""

    def increment(self, x: Any, rate: Any, shape: Any, u: Any) -> Any:
        spent = rate * shape * u * np.exp(np.minimum(shape * x, _LARGEST))
        grown = np.where(spent < 1.0, -np.log1p(-spent) / shape, np.inf)
        return np.where(shape == 0.0, rate * u, grown)

    def hours(self, x: Any, rate: Any, shape: Any, limit: Any) -> Any:
        bent = -np.exp(-shape * x) * np.expm1(-shape * (limit - x)) / (rate * shape)
        return np.where(shape == 0.0, (limit - x) / rate, bent)


class _Power:
    """Law x = (u / c)^p; ``rate`` is the time scale c."""

    def increment(self, x: Any, rate: Any, shape: Any, u: Any) -> Any:
        age = x ** (1.0 / shape) + u / rate
        return np.where(age > 0.0, np.exp(np.minimum(shape * np.log(age), _LARGEST)), 0.0) - x

    def hours(self, x: Any, rate: Any, shape: Any, limit: Any) -> Any:
        return rate * (limit ** (1.0 / shape) - x ** (1.0 / shape))


_SOLUTIONS: Final[Mapping[str, _Solution]] = {
    "constant": _Constant(),
    "linear": _Linear(),
    "exponential": _Exponential(),
    "archard": _Archard(),
    "self_heating": _SelfHeating(),
    "power": _Power(),
    "drift": _Linear(),
}

EXACT_LAWS: Final = tuple(_SOLUTIONS)
"""Names of the laws with an exact solution, which can be simulated."""

GROWING_LAWS: Final = EXACT_LAWS[1:]
"""Names of the laws with growth, which a user can select as the known law of a fault."""

TIME_SCALE_LAWS: Final = frozenset({"power"})
"""Names of the laws whose rate is a time scale [h]: the longer it is, the slower the growth."""


@dataclass(frozen=True)
class TypicalGrowth:
    """Typical growth of a fault."""

    law: str
    """One of ``EXACT_LAWS``."""
    rate: float
    """Median of the rate a [1/h], or of the time scale c [h] for ``power``."""
    shape: float = 0.0
    """Second parameter of the law [-]."""
    rate_sigma: float = 0.3
    """Standard deviation of the logarithm of the rate [-]."""
    diffusion: float = 0.0
    """Diffusion s of ``drift`` [1/sqrt(h)]."""
    latest_onset: float = 0.0
    """Latest start of growth [h]; the start is uniformly distributed from 0."""


def increment(
    law: str, x: ArrayLike, rate: ArrayLike, shape: ArrayLike, hours: ArrayLike
) -> NDArray[np.float64]:
    """Return the growth of a fault over a number of hours, without process noise.

    Parameters
    ----------
    law
        One of ``EXACT_LAWS``.
    x
        Distance from healthy at the start [-].
    rate
        Rate a [1/h]; for ``power``, time scale c [h].
    shape
        Second parameter of the law [-]; ignored by laws without one.
    hours
        Service hours, at least 0 [h].

    Returns
    -------
    numpy.ndarray
        Increment of x [-], in the common shape; infinite where the solution is unbounded.

    Raises
    ------
    ValueError
        If the law is unknown.
    """
    x, rate, shape, u = (np.asarray(item, dtype=np.float64) for item in (x, rate, shape, hours))
    with np.errstate(all="ignore"):
        return _solution(law).increment(x, rate, shape, u)


def hours_until(
    law: str, x: ArrayLike, rate: ArrayLike, shape: ArrayLike, limit: ArrayLike
) -> NDArray[np.float64]:
    """Return the hours until a fault first reaches a limit, without process noise.

    Parameters
    ----------
    law
        One of ``EXACT_LAWS``.
    x
        Distance from healthy at the start [-].
    rate
        Rate a [1/h]; for ``power``, time scale c [h].
    shape
        Second parameter of the law [-]; ignored by laws without one.
    limit
        Distance from healthy at which life ends [-].

    Returns
    -------
    numpy.ndarray
        Hours [h], in the common shape: 0 if x is at the limit or above, infinite if x never reaches
        the limit.

    Raises
    ------
    ValueError
        If the law is unknown.
    """
    x, rate, shape, limit = (np.asarray(item, dtype=np.float64) for item in (x, rate, shape, limit))
    with np.errstate(all="ignore"):
        hours = _solution(law).hours(x, rate, shape, limit)
    return np.where(x >= limit, 0.0, hours)


def _solution(law: str) -> _Solution:
    if law not in _SOLUTIONS:
        raise ValueError(f"law = {law!r} is unknown; known: {', '.join(EXACT_LAWS)}")
    return _SOLUTIONS[law]
