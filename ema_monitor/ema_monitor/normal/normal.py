"""A unit's own normal: how far its healthy tests scatter, and how unlikely a later one is (M47)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np

from ema_monitor.normal.features import FEATURES, FIGURE, LEVEL, RATIO, Feature

FEWEST_TESTS: Final = 3
"""Healthy tests below which nothing can be said of their scatter."""

HEALTHY: Final = "healthy"
"""State of the tests that are the unit's normal."""

NONE_OF_THESE: Final = "none of these"
"""What a test is called that looks like no labelled one."""

DEPARTED: Final = 1e-2
"""Probability below which a test departs."""

_LEAST_SAID: Final = 1e-4
_SAID: Final = 0.05
_FLOOR: Final = {LEVEL: 0.01, RATIO: 0.07, FIGURE: 0.03}
_FLOOR_OF_DAYS: Final = {LEVEL: 0.10, RATIO: 0.20, FIGURE: 0.10}
_USUAL_BETWEEN_DAYS: Final = (
    "it would depart on the day of the healthy windows; "
    f"{_FLOOR_OF_DAYS[LEVEL]:.0%} of the current and {_FLOOR_OF_DAYS[RATIO]:.0%} of a scatter are "
    "taken for usual between days"
)
_FLOOR_FREEDOM: Final = 20.0
_NS_A_DAY: Final = 86_400_000_000_000


@dataclass(frozen=True)
class HealthyTest:
    """Figures of a healthy test by name, and when it was [ns]."""

    stamp_ns: int
    features: Mapping[str, float]

    @property
    def day(self) -> int:
        """Day of the test, counted from 1970."""
        return self.stamp_ns // _NS_A_DAY


class Change(NamedTuple):
    """A figure that departs.

    ``healthy`` and ``value`` are in its own unit, or logarithms; ``z`` is their difference over the
    scatter, ``probability`` that of so large a difference in a healthy test, for this figure alone.
    """

    name: str
    feature: Feature
    healthy: float
    value: float
    z: float
    probability: float

    def __str__(self) -> str:
        if self.feature.kind == LEVEL:
            share = f" ({self.value / self.healthy - 1.0:+.0%})" if self.healthy > 0.0 else ""
            return f"{self.feature.words} is {self.value:.3g} instead of {self.healthy:.3g}{share}"
        return f"{self.feature.words} is {math.exp(self.value - self.healthy):.2g} times as large"


@dataclass(frozen=True)
class Departure:
    """How unlikely a test is for the healthy unit.

    ``probability`` is that of a healthy test to depart so far in one of its figures; ``changes``
    are the figures that depart, the most significant first; ``remark`` says that they would, were
    the test of the day of the healthy ones. ``load_explains`` says that a load may be what departs.
    ``states`` are the probabilities of states that the owner has named, and of none of them, the
    largest first; empty where there are none to compare with, and ``unnamed`` then says why.
    """

    probability: float
    changes: tuple[Change, ...]
    remark: str = ""
    load_explains: bool = True
    states: Mapping[str, float] = field(default_factory=dict)
    unnamed: str = ""

    @property
    def is_significant(self) -> bool:
        """Whether the test departs."""
        return self.probability < DEPARTED

    @property
    def is_named(self) -> bool:
        """Whether it looks like a state that the owner has named, and not like a healthy unit."""
        return next(iter(self.states), HEALTHY) not in (HEALTHY, NONE_OF_THESE)

    @property
    def likeness(self) -> str:
        """Which states it looks like, in words, or why none is named."""
        states = [f"{name} {share:.0%}" for name, share in self.states.items() if share >= _SAID]
        return f"looks like: {', '.join(states)}" if states else self.unnamed

    def __str__(self) -> str:
        if not self.is_significant:
            return "as healthy tests are"
        named = "; ".join(str(one) for one in self.changes[:3])
        words = f"departed ({_share(self.probability)} does so): {named}"
        return "; ".join(filter(None, [words, self.likeness]))


class Normal:
    """Scatter of the healthy tests of a unit, under one command and load.

    Each figure has a mean and a standard deviation, which is never below a floor: 1 % of the
    running current, 7 % of a scatter, 3 % of a figure of a move. Of tests on several days the means
    of the days count, so that the drift between them is part of the scatter. Where all are of one
    or two days, 10 % of the running current and 20 % of a scatter are taken for usual between days,
    for tests of another day.

    Raises
    ------
    ValueError
        When there are fewer healthy tests than ``FEWEST_TESTS``, or they share no figure.
    """

    def __init__(
        self, tests: Sequence[HealthyTest], features: Mapping[str, Feature] = FEATURES
    ) -> None:
        if len(tests) < FEWEST_TESTS:
            raise ValueError(
                f"{len(tests)} healthy tests: expected {FEWEST_TESTS} or more, to see their scatter"
            )
        self.names = [name for name in features if all(name in one.features for one in tests)]
        if not self.names:
            raise ValueError("the healthy tests have no figure in common")
        self._features = features
        self.days = sorted({one.day for one in tests})
        values = np.array([[one.features[name] for name in self.names] for one in tests])
        if len(self.days) >= FEWEST_TESTS:
            of_day = np.array([one.day for one in tests])
            values = np.array([values[of_day == day].mean(axis=0) for day in self.days])
        self._count = len(values)
        self._mean = values.mean(axis=0)
        self._variance = values.var(axis=0, ddof=1) * (1.0 + 1.0 / self._count)
        is_level = [features[name].kind == LEVEL for name in self.names]
        self._running = float(np.max(np.abs(self._mean[is_level]), initial=0.0))

    def departure(self, test: HealthyTest) -> Departure:
        """Return how unlikely a test is; figures that it lacks do not count.

        Raises
        ------
        ValueError
            When it has none of the figures.
        """
        if len(self.days) >= FEWEST_TESTS or test.day in self.days:
            return self._departure(test, _FLOOR)
        found = self._departure(test, _FLOOR_OF_DAYS)
        if found.is_significant or not self._departure(test, _FLOOR).is_significant:
            return found
        return replace(found, remark=_USUAL_BETWEEN_DAYS)

    def _departure(self, test: HealthyTest, floors: Mapping[str, float]) -> Departure:
        from scipy.special import stdtr  # 0.1 s, where there is no normal

        names = [name for name in self.names if name in test.features]
        if not names:
            raise ValueError(f"the test has none of the figures {', '.join(self.names)}")
        changes = []
        for name in names:
            at, feature = self.names.index(name), self._features[name]
            unit = self._running if feature.kind == LEVEL else 1.0
            floor = (floors[feature.kind] * unit) ** 2
            variance = self._variance[at] + floor
            if not variance > 0.0:
                continue
            # Satterthwaite: of both parts, the scatter has been seen ``count`` times.
            share = self._variance[at] / variance
            freedom = 1.0 / (share**2 / (self._count - 1) + (1.0 - share) ** 2 / _FLOOR_FREEDOM)
            z = float((test.features[name] - self._mean[at]) / math.sqrt(variance))
            probability = float(2.0 * stdtr(freedom, -abs(z)))
            figures = float(self._mean[at]), float(test.features[name])
            changes.append(Change(name, feature, *figures, z, probability))
        changes.sort(key=lambda one: one.probability)
        # Bonferroni: holds however the figures depend on each other.
        smallest = min(1.0, changes[0].probability * len(changes)) if changes else 1.0
        significant = [one for one in changes if one.probability * len(changes) < DEPARTED]
        return Departure(smallest, tuple(significant))


def _share(probability: float) -> str:
    """Return how many healthy tests are as unlikely, in words."""
    least = max(probability, _LEAST_SAID)
    number = float(f"{1.0 / least:.2g}")
    return f"{'at most ' if probability < least else ''}1 in {number:,.0f} healthy tests"
