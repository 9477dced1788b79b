"""Abrupt changes of the rate of growth: another mission, another load, lost lubrication.

The latest tests of each component are explained by two straight lines that meet at a test, and by
growth without a break: a parabola, a cubic, a line with an exponential, and lines under waves. The
errors of the tests and the noise of the growth between them are as the tracker knows them
(generalised least squares). A change is told once the broken line explains the tests better than
all others by a margin of its sum of squares, so that neither growth that accelerates nor a season
is taken for one (the generalised likelihood ratio of Willsky and Jones 1976, with rivals).
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import COMPONENTS
from ema_monitor.prognosis.growth.outliers import Event
from ema_monitor.prognosis.growth.waves import PERIODS

REGIME: Final = "regime"

TESTS: Final = 80
"""Latest tests of a component that are looked at."""

_BESIDE: Final = 6
"""Tests before and after a break, at least."""

_MARGIN: Final = 16.0
"""Sum of squares by which a broken line has to be better than a parabola [-]."""

_MARGIN_OVER_RIVALS: Final = 6.0
"""The same against curves of as many figures as it has [-]."""

_LEAST_RATIO: Final = 1.6
"""Ratio of the rates below which a change is not told [-]."""

_SIGNIFICANT: Final = 3.0
_ODD_SIGMAS: Final = 4.0
_SCALES: Final = (0.1, 0.2, 0.4)
_LEAST_HINGE: Final = 1e-9

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RegimeChange:
    """A change of the rate of growth.

    Attributes
    ----------
    hours
        Service hour at which it happened, by the tests [h].
    before, after
        Rates [1/h].
    sigma
        Standard deviation of the rate after it [1/h].
    """

    hours: float
    before: float
    after: float
    sigma: float


@dataclass(frozen=True)
class GrowthNoise:
    """What else than a change of its rate moves a component from test to test.

    Attributes
    ----------
    correlation
        Correlation of the errors of successive tests [-].
    large
        Standard deviation of an occasional error [-].
    hours
        Variance of the effective time of growth per hour in service [h].
    diffusion
        Diffusion of its growth [1/sqrt(h)].
    """

    correlation: float
    large: float
    hours: float
    diffusion: float


def regime_event(name: str, change: RegimeChange) -> Event:
    """Return the event that tells of a change of a component's rate."""
    factor = change.after / change.before
    return Event(
        REGIME,
        name,
        change.hours,
        f"{name} grows {factor:.2g} times as fast since about {change.hours:.0f} h: "
        f"{1e3 * change.after:+.3g} in 1000 h after {1e3 * change.before:+.3g}",
    )


class RegimeWatch:
    """Keeps the latest tests of each component and finds changes of its rate in them."""

    def __init__(self) -> None:
        n = len(COMPONENTS)
        self._count = np.zeros(n, dtype=np.intp)
        # Hours of growth, values, variances of their errors, and service hours, the latest last.
        self._kept = np.zeros((n, 4, TESTS))

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all that is known, for ``restore``."""
        return {"regime_tests": self._kept, "regime_counts": self._count}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what ``state`` returned."""
        self._kept, self._count = state["regime_tests"], state["regime_counts"]

    def restart(self, number: int) -> None:
        """Forget the tests of a component: its level has changed."""
        self._count[number] = 0

    def add(
        self, hours: Array, value: Array, noise: Array, used: NDArray[np.bool_], service: float
    ) -> None:
        """Add a test.

        Parameters
        ----------
        hours
            Hours of growth of each component, ``(7,)`` [h].
        value, noise
            Signed distances from healthy and variances of their errors, ``(7,)``.
        used
            Components that it measures, ``(7,)``.
        service
            Service hours of the test [h].
        """
        self._kept[used] = np.roll(self._kept[used], -1, axis=2)
        self._kept[used, 0, -1] = hours[used]
        self._kept[used, 1, -1] = value[used]
        self._kept[used, 2, -1] = noise[used]
        self._kept[used, 3, -1] = service
        self._count = np.minimum(self._count + used, TESTS)

    def judge(self, number: int, noise: GrowthNoise) -> RegimeChange | None:
        """Return the change that the tests of a component show, and forget those before it.

        Parameters
        ----------
        number
            The component.
        noise
            Errors of the tests and noise of the growth.
        """
        count = int(self._count[number])
        if count < 3 * _BESIDE:
            return None
        hours, value, variance, service = self._kept[number, :, TESTS - count :]
        change, tests_after = _found(hours, value, variance, service, noise)
        if change is not None:
            self._count[number] = tests_after
        return change


def _found(
    hours: Array, value: Array, variance: Array, service: Array, noise: GrowthNoise
) -> tuple[RegimeChange | None, int]:
    """Return the change that tests show, and how many tests there are after it."""
    span = hours[-1] - hours[0]
    if not span > 0.0:
        return None, 0
    t = (hours - hours[0]) / span
    white = _whitener(hours, value, variance, noise)
    y, one = white @ value, np.ones_like(t)
    base = white @ np.stack([one, t], axis=1)
    breaks = np.arange(_BESIDE, t.size - _BESIDE)
    # Tests of one hour, as on the ground, have no growth between them.
    breaks = breaks[(t[breaks] > 0.0) & (t[breaks] < 1.0)]
    if not breaks.size:
        return None, 0
    q, _ = np.linalg.qr(base)
    hinges = white @ np.maximum(t[:, None] - t[breaks], 0.0)
    rest = y - q @ (q.T @ y)
    hinges -= q @ (q.T @ hinges)
    gains = (hinges.T @ rest) ** 2 / np.maximum(np.sum(hinges**2, axis=0), _LEAST_HINGE)
    at = int(breaks[np.argmax(gains)])
    broken = float(rest @ rest - gains.max())
    squares = [_left(white, y, [one, t, t**2])]
    if squares[0] - broken < _MARGIN:
        return None, 0
    squares = [_left(white, y, [one, t, t**2, t**3])]
    # Growth that accelerates, and growth that settles.
    for scale in _SCALES:
        squares += [_left(white, y, [one, t, np.exp((t - 1.0) / scale)])]
        squares += [_left(white, y, [one, t, np.exp(-t / scale)])]
    turns = 2.0 * np.pi * span / PERIODS
    squares += [_left(white, y, [one, t, np.cos(w * t), np.sin(w * t)]) for w in turns]
    if min(squares) - broken < _MARGIN_OVER_RIVALS:
        return None, 0
    design = white @ np.stack([one, np.minimum(t, t[at]), np.maximum(t - t[at], 0.0)], axis=1)
    covariance = np.linalg.inv(design.T @ design)
    rates = covariance @ design.T @ y / span
    sigmas = np.sqrt(np.diag(covariance)) / span
    before, after = float(rates[1]), float(rates[2])
    growth = math.copysign(1.0, value[-1]) * before
    low, high = sorted((abs(before), abs(after)))
    if growth < _SIGNIFICANT * sigmas[1] or high < _LEAST_RATIO * low:
        return None, 0
    return RegimeChange(float(service[at]), before, after, float(sigmas[2])), t.size - at


def _whitener(hours: Array, value: Array, variance: Array, noise: GrowthNoise) -> Array:
    """Return the inverse root of the covariance of the tests about the mean growth."""
    # A value far from both beside it has an occasional error.
    middle = 0.5 * (value[:-2] + value[2:])
    odd = np.abs(value[1:-1] - middle) > _ODD_SIGMAS * np.sqrt(1.5 * variance[1:-1])
    sigma = np.sqrt(variance + noise.large**2 * np.pad(odd, 1))
    order = np.arange(hours.size)
    lasting = noise.correlation ** np.abs(order[:, None] - order)
    rate = (value[-1] - value[0]) / (hours[-1] - hours[0])
    since = hours - hours[0]
    an_hour = rate**2 * noise.hours + noise.diffusion**2
    growth = an_hour * np.minimum(since[:, None], since)
    return np.linalg.inv(np.linalg.cholesky(np.outer(sigma, sigma) * lasting + growth))


def _left(white: Array, y: Array, curves: list[Array]) -> float:
    """Return the sum of squares that a sum of curves leaves."""
    q, _ = np.linalg.qr(white @ np.stack(curves, axis=1))
    part = q.T @ y
    return float(y @ y - part @ part)
