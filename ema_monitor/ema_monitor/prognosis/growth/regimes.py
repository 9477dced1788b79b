"""Abrupt changes of the rate of growth: another mission, another load, lost lubrication (P9a).

Two lines that meet at a test are fitted to the latest tests, and growth without a break: a
parabola, a cubic, an exponential, waves. A change is reported if the broken line is better than all
others by a margin (generalised likelihood ratio: Willsky and Jones 1976, with rivals).
"""

import math
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS
from ema_monitor.prognosis.growth.kept import Kept
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.outliers import Event
from ema_monitor.prognosis.growth.settings import TrackerSettings
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
"""Smallest ratio of the rates that is reported as a change [-]."""

_SIGNIFICANT: Final = 3.0
_ODD_SIGMAS: Final = 4.0
_SCALES: Final = (0.1, 0.2, 0.4)
_LEAST_HINGE: Final = 1e-9


class RegimeChange(NamedTuple):
    """A change of the rate of growth."""

    hours: float  # service hour at which it happened, by the tests [h]
    before: float  # rates [1/h]
    after: float
    tests: int  # after it

    def event(self, name: str) -> Event:
        """Return the event of a change of a component's rate."""
        return Event(
            REGIME,
            name,
            self.hours,
            f"{name} grows {self.after / self.before:.2g} times as fast since about "
            f"{self.hours:.0f} h: {1e3 * self.after:+.3g} in 1000 h after {1e3 * self.before:+.3g}",
        )


class RegimeWatch(Kept):
    """Keeps the latest tests of each component and finds changes of its rate in them."""

    kept = ("_tests", "_count")

    def __init__(self) -> None:
        n = len(COMPONENTS)
        self._count = np.zeros(n, dtype=np.intp)
        # Hours of growth, values, variances of their errors, and service hours, the latest last.
        self._tests = np.zeros((n, 4, TESTS))

    def restart(self, number: int) -> None:
        """Forget the tests of a component: its level has changed."""
        self._count[number] = 0

    def add(self, test: Measurement, used: Flags) -> None:
        """Add the components that a test measures, ``(7,)``."""
        service = np.full_like(test.noise, test.hours)
        row = np.stack([test.own_hours, test.value, test.noise, service], axis=1)
        self._tests[used] = np.append(self._tests[used][..., 1:], row[used, :, None], axis=2)
        self._count = np.minimum(self._count + used, TESTS)

    def judge(self, number: int, settings: TrackerSettings) -> RegimeChange | None:
        """Return the change that the tests of a component show, and forget those before it."""
        count = int(self._count[number])
        if count < 3 * _BESIDE:
            return None
        change = _found(self._tests[number, :, TESTS - count :], settings)
        if change is not None:
            self._count[number] = change.tests
        return change


def _found(tests: Array, settings: TrackerSettings) -> RegimeChange | None:
    """Return the change that tests show."""
    hours, value, variance, service = tests
    span = hours[-1] - hours[0]
    if not span > 0.0:
        return None
    t = (hours - hours[0]) / span
    breaks = np.arange(_BESIDE, t.size - _BESIDE)
    # Tests of one hour, as on the ground, have no growth between them.
    breaks = breaks[(t[breaks] > 0.0) & (t[breaks] < 1.0)]
    if not breaks.size:
        return None
    white = _whitener(hours, value, variance, settings)
    y, line = white @ value, [np.ones_like(t), t]
    q, _ = np.linalg.qr(white @ np.stack(line, axis=1))
    hinges = white @ np.maximum(t[:, None] - t[breaks], 0.0)
    rest = y - q @ (q.T @ y)
    hinges -= q @ (q.T @ hinges)
    gains = (hinges.T @ rest) ** 2 / np.maximum(np.sum(hinges**2, axis=0), _LEAST_HINGE)
    at = int(breaks[np.argmax(gains)])
    broken = float(rest @ rest - gains.max())
    if _left(white, y, [*line, t**2]) - broken < _MARGIN:
        return None
    # Growth that accelerates, growth that settles, and waves.
    rivals = [[t**2, t**3]]
    rivals += [[np.exp((t - 1.0) / scale)] for scale in _SCALES]
    rivals += [[np.exp(-t / scale)] for scale in _SCALES]
    rivals += [[np.cos(w * t), np.sin(w * t)] for w in 2.0 * np.pi * span / PERIODS]
    if min(_left(white, y, line + rival) for rival in rivals) - broken < _MARGIN_OVER_RIVALS:
        return None
    design = white @ np.stack([line[0], np.minimum(t, t[at]), np.maximum(t - t[at], 0.0)], axis=1)
    covariance = np.linalg.inv(design.T @ design)
    _, before, after = (covariance @ design.T @ y / span).tolist()
    sigma = math.sqrt(covariance[1, 1]) / span
    growth = math.copysign(1.0, value[-1]) * before
    low, high = sorted((abs(before), abs(after)))
    if growth < _SIGNIFICANT * sigma or high < _LEAST_RATIO * low:
        return None
    return RegimeChange(float(service[at]), before, after, t.size - at)


def _whitener(hours: Array, value: Array, variance: Array, settings: TrackerSettings) -> Array:
    """Return the inverse root of the covariance of the tests about the mean growth."""
    # A value far from both neighbours has an occasional error.
    middle = 0.5 * (value[:-2] + value[2:])
    odd = np.abs(value[1:-1] - middle) > _ODD_SIGMAS * np.sqrt(1.5 * variance[1:-1])
    sigma = np.sqrt(variance + settings.occasional_error**2 * np.pad(odd, 1))
    rate = (value[-1] - value[0]) / (hours[-1] - hours[0])
    since = hours - hours[0]
    growth = rate**2 * settings.noise_hours * np.minimum(since[:, None], since)
    return np.linalg.inv(np.linalg.cholesky(np.diag(sigma**2) + growth))


def _left(white: Array, y: Array, curves: list[Array]) -> float:
    """Return the sum of squares that a sum of curves leaves."""
    q, _ = np.linalg.qr(white @ np.stack(curves, axis=1))
    part = q.T @ y
    return float(y @ y - part @ part)
