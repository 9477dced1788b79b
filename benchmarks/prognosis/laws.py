# SPDX-License-Identifier: Apache-2.0
"""Foreign laws of growth: they are independent of the laws of the tracker and of ``ema_sim``.

The parameters of a law are drawn for each life. The tracker has laws similar to a few of them:
logistic growth, jumps and powers of time.

Faults are in shares of the limit, y = x / limit, and u is the time of growth in hours. Laws step
many samples simultaneously, so that an oracle can continue a life with the code that made it. The
laws of ``HELD_OUT`` are not used in development: the tracker is run on them once, at the end.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Law:
    """A law of growth with the parameters of one life.

    Most laws have no random states and no wave. A new or repaired component begins at ``start``
    [-].
    """

    start = 0.0

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        """Draw the parameters of a life of ``life`` hours."""

    def states(self, n: int, rng: np.random.Generator) -> Array:
        """Return the initial random states of n samples, ``(k, n)``."""
        return np.empty((0, n))

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        """Return the growth over h hours from hour u on [-], ``(n,)``. Updates ``states``."""
        raise NotImplementedError

    def wave(self, u: Array | float) -> Array | float:
        """Return the reversible part of the fault at an hour, as a share of the limit [-]."""
        return 0.0 * u


class Logistic(Law):
    """dy/du = k y (1 - y / K): growth accelerates, then slows down towards K above the limit."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.start, self.top = rng.uniform(0.02, 0.06), rng.uniform(1.05, 1.6)
        odds = (self.top - self.start) / self.start / (self.top - 1.0)
        self.k = np.log(odds) / life

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        return self.k * h * y * (1.0 - y / self.top)


class Missions(Law):
    """Linear wear whose rate depends on the mission, which changes every few hundred hours."""

    factors = np.array([0.5, 1.0, 2.0])

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.life, self.hours = life, rng.uniform(100.0, 400.0)

    def states(self, n: int, rng: np.random.Generator) -> Array:
        return np.stack([rng.choice(self.factors, n), rng.exponential(self.hours, n)])

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        states[1] -= h
        ended = np.flatnonzero(states[1] < 0.0)
        states[0, ended] = rng.choice(self.factors, ended.size)
        states[1, ended] = rng.exponential(self.hours, ended.size)
        return states[0] * (h / self.life / self.factors.mean())


class Avalanche(Law):
    """Failing insulation: linear growth up to an onset, then dy/du = g (y + c)^m.

    The onset is at 35 to 60 % of the life, with y = 0.08 to 0.2.
    """

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.onset, self.slow = rng.uniform(0.35, 0.6) * life, rng.uniform(0.08, 0.2)
        self.c, self.m = rng.uniform(0.05, 0.15), rng.uniform(1.05, 1.4)
        self.rate, power = self.slow / self.onset, 1.0 - self.m
        span = ((1.0 + self.c) ** power - (self.slow + self.c) ** power) / power
        self.g = span / (life - self.onset)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        return h * (
            self.g * (y + self.c) ** self.m if u > self.onset else np.full_like(y, self.rate)
        )


class Seasonal(Law):
    """Linear growth with a wave of 3 to 6 % of the limit and a period of 300 to 1000 h.

    For a limit of half the range, the wave has up to 3 % of the range.
    """

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.life, self.amplitude = life, rng.uniform(0.03, 0.06)
        self.period, self.phase = rng.uniform(300.0, 1000.0), rng.uniform(0.0, 2.0 * np.pi)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        return np.full_like(y, h / self.life)

    def wave(self, u: Array | float) -> Array | float:
        return self.amplitude * np.sin(2.0 * np.pi * u / self.period + self.phase)


class Paris(Law):
    """dy/du = C y^m from a small initial crack on: Paris' law, with y the length of the crack."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.start, self.m = rng.uniform(0.1, 0.25), rng.uniform(1.2, 1.7)
        power = 1.0 - self.m
        self.c = (1.0 - self.start**power) / power / life

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        return h * self.c * y**self.m


class LostLubrication(Law):
    """Linear wear whose rate changes once, permanently."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.at = rng.uniform(0.35, 0.65) * life
        self.factor = rng.uniform(2.0, 4.0) if rng.random() < 0.7 else rng.uniform(0.3, 0.6)
        self.rate = 1.0 / (self.at + self.factor * (life - self.at))

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        return np.full_like(y, h * self.rate * (self.factor if u > self.at else 1.0))


class Weibull(Law):
    """y follows a Weibull distribution function, an S whose steepest part is before the limit."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.shape, self.reached = rng.uniform(1.8, 3.5), rng.uniform(0.6, 0.95)
        self.scale = life / (-np.log1p(-self.reached)) ** (1.0 / self.shape)

    def _value(self, u: float) -> float:
        return float(-np.expm1(-((u / self.scale) ** self.shape)) / self.reached)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        return np.full_like(y, self._value(u + h) - self._value(u))


class Staged(Law):
    """Creep in three stages: saturating, steady and accelerating growth."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        shares = rng.dirichlet([4.0, 5.0, 6.0])
        first, last = rng.uniform(0.05, 0.15) * life, rng.uniform(0.1, 0.2) * life
        self.parts = (*(shares / [1.0, life, 1.0]), first, last, life)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        settling, steady, ending, first, last, life = self.parts
        rate = settling / first * np.exp(-u / first) + steady
        return np.full_like(y, h * (rate + ending / last * np.exp((u - life) / last)))


class Shocks(Law):
    """Damage in steps: a compound Poisson process in addition to slow steady wear."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.life, self.shocks = life, rng.uniform(40.0, 100.0)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        count = rng.poisson(self.shocks * h / self.life, y.size)
        return 0.2 * h / self.life + 0.8 / self.shocks * rng.standard_gamma(count)


class Thermal(Law):
    """Wear at a rate with seasonal modulation."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.life, self.depth = life, rng.uniform(0.4, 0.8)
        self.period, self.phase = rng.uniform(300.0, 1000.0), rng.uniform(0.0, 2.0 * np.pi)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        rate = 1.0 + self.depth * np.sin(2.0 * np.pi * u / self.period + self.phase)
        return np.full_like(y, h / self.life * rate)


class RunningIn(Law):
    """y = (u / T)^p with p < 1: wear that keeps slowing down."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.life, self.p = life, rng.uniform(0.5, 0.8)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        grown = ((u + h) / self.life) ** self.p - (u / self.life) ** self.p
        return np.full_like(y, grown)


class Wandering(Law):
    """Linear wear whose logarithmic rate is an Ornstein-Uhlenbeck process."""

    sigma = 0.6

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.life, self.hours = life, rng.uniform(150.0, 500.0)

    def states(self, n: int, rng: np.random.Generator) -> Array:
        return self.sigma * rng.standard_normal((1, n))

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        kept = np.exp(-h / self.hours)
        spread = self.sigma * np.sqrt(1.0 - kept**2)
        states[0] = kept * states[0] + spread * rng.standard_normal(y.size)
        return h / self.life * np.exp(states[0] - 0.5 * self.sigma**2)


class Gamma(Law):
    """Gamma process with the variance of 20 to 100 exponential jumps at the limit."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.life, self.jumps = life, rng.uniform(20.0, 100.0)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        return rng.standard_gamma(self.jumps * h / self.life, y.size) / self.jumps


class Breakaway(Law):
    """Slow wear, followed by exponential growth late in life."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.at, self.slow = rng.uniform(0.55, 0.8) * life, rng.uniform(0.1, 0.4)
        self.growth = -np.log(self.slow) / (life - self.at)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        return h * (self.growth * y if u > self.at else np.full_like(y, self.slow / self.at))


class GrowingShocks(Law):
    """Shocks whose frequency increases with the damage."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.size, self.factor = 1.0 / rng.uniform(25.0, 80.0), rng.uniform(1.0, 4.0)
        self.rate = np.log1p(self.factor) / (self.factor * life)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        mean = self.rate * (1.0 + self.factor * y) * h
        return self.size * rng.standard_gamma(rng.poisson(mean / self.size))


class Idle(Law):
    """Linear wear during work, which alternates with pauses."""

    def __init__(self, life: float, rng: np.random.Generator) -> None:
        self.rate, self.hours = 1.0 / (0.6 * life), rng.uniform(30.0, 100.0)

    def states(self, n: int, rng: np.random.Generator) -> Array:
        return (rng.random((1, n)) < 0.6).astype(float)

    def step(self, y: Array, u: float, h: float, states: Array, rng: np.random.Generator) -> Array:
        drawn = (rng.random(y.size) < 0.6).astype(float)
        states[0] = np.where(rng.random(y.size) < np.exp(-h / self.hours), states[0], drawn)
        return self.rate * h * states[0]


class Kind(NamedTuple):
    """A law, and the kinds of fault that it applies to."""

    law: type[Law]
    faults: tuple[str, ...]


_WORN: Final = ("friction", "backlash", "eccentricity")
_ALL: Final = (*_WORN, "short_circuit", "gain")

DEVELOPMENT: Final[Mapping[str, Kind]] = {
    "logistic": Kind(Logistic, _ALL),
    "missions": Kind(Missions, _ALL),
    "avalanche": Kind(Avalanche, ("short_circuit",)),
    "seasonal": Kind(Seasonal, _WORN),
    "paris": Kind(Paris, _ALL),
    "lost lubrication": Kind(LostLubrication, _WORN),
}
"""Laws that the tracker was developed with."""

HELD_OUT: Final[Mapping[str, Kind]] = {
    "weibull": Kind(Weibull, _ALL),
    "staged": Kind(Staged, _ALL),
    "shocks": Kind(Shocks, _ALL),
    "thermal": Kind(Thermal, _WORN),
    "running in": Kind(RunningIn, _ALL),
    "wandering": Kind(Wandering, _ALL),
}
"""Laws that were not used in development."""

SETS: Final[Mapping[str, Mapping[str, Kind]]] = {
    "development": DEVELOPMENT,
    "held out": HELD_OUT,
    "seen": {"gamma": Kind(Gamma, _ALL), "breakaway": Kind(Breakaway, _ALL)},
    "unseen": {"growing shocks": Kind(GrowingShocks, _ALL), "idle": Kind(Idle, _ALL)},
}
"""Sets of laws by name. Growth by jumps was developed with "seen" and tested with "unseen"."""
