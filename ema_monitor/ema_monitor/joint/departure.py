"""Figures of a test that need no model beside those of healthy tests: which depart, how unlikely.

Each figure is compared with its prediction from the healthy tests (``single``); Bonferroni over
the figures holds however they depend on each other.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from ema_monitor.joint.scatter import Scatter
from ema_monitor.joint.single import POWER, SIGNIFICANCE, Observation, SingleTest, scatter_of

HEALTHY: Final = "healthy"
"""State of the tests and records of a baseline."""

NONE_OF_THESE: Final = "none of these"
"""State of a test or record that looks like no labelled one."""

FEWEST: Final = 3
"""Tests or records below which a state is not judged and not named."""

_LEAST_SAID: Final = 1e-6
_KEPT_SCATTERS: Final = 1024
_MOST_NAMED: Final = 3
_SAID: Final = 0.05
_TINY: Final = 1e-12


class JudgedFigure(NamedTuple):
    """A figure of a test.

    Attributes
    ----------
    label
        Name in words.
    between_days
        Prior median of its standard deviation between days: of the logarithm, or of a level as a
        share of the largest healthy level [-].
    is_logarithm
        Whether the figure is a logarithm; else it is a level [A].
    error
        Standard deviation of the error of the figure of one test, as ``between_days``. Healthy
        tests in quick succession scatter less.
    """

    label: str
    between_days: float
    is_logarithm: bool = True
    error: float = 0.0


class DatedFigures(NamedTuple):
    """Figures of a test by name, and its day, counted from 1970."""

    day: int
    values: Mapping[str, float]


class Change(NamedTuple):
    """A figure that departs.

    Attributes
    ----------
    name
        Name of the figure.
    figure
        What it is.
    test
        The figure beside its prediction from the healthy tests.
    probability
        Probability that a healthy test differs as much in this figure.
    limit
        Probability below which the figure departs.
    """

    name: str
    figure: JudgedFigure
    test: SingleTest
    probability: float
    limit: float

    @property
    def healthy(self) -> float:
        """Figure that is predicted from the healthy tests."""
        return self.test.prediction.mean

    @property
    def smallest_change(self) -> float:
        """Smallest change of the figure that would depart with a probability of 90 %."""
        return self.test.prediction.smallest_change(self.limit, POWER)

    @property
    def change_text(self) -> str:
        """Change with its sign and unit."""
        return self._text(self.test.change, "+")

    @property
    def smallest_text(self) -> str:
        """Smallest change that would depart, with its unit."""
        return self._text(self.smallest_change)

    def _text(self, change: float, sign: str = "") -> str:
        if self.figure.is_logarithm:
            return f"{100.0 * math.expm1(change):{sign}.0f} %"
        if self.healthy > 0.0:
            return f"{100.0 * change / self.healthy:{sign}.0f} %"
        return f"{change:{sign}.3g} A"

    def __str__(self) -> str:
        if self.figure.is_logarithm:
            times = math.exp(self.test.change)
            return f"{self.figure.label} is {times:.3g} times the healthy one"
        levels = f"is {self.test.value:.3g} A, healthy {self.healthy:.3g} A"
        share = f" ({self.change_text})" if self.healthy > 0.0 else ""
        return f"{self.figure.label} {levels}{share}"


@dataclass(frozen=True)
class Departure:
    """How unlikely a test is for the healthy unit.

    Attributes
    ----------
    probability
        Probability that a healthy test differs as much in one of its figures.
    changes
        Figures that depart, the most significant first.
    remark
        Which change would depart, if the test would have departed on the day of the healthy tests.
    load_explains
        Whether a load may be what departs.
    states
        Probabilities of the labelled states and of none of them, the largest first; empty if there
        are none to compare with.
    unnamed
        Why ``states`` is empty although states are labelled.
    significance
        Probability below which the test departs.
    """

    probability: float
    changes: tuple[Change, ...] = ()
    remark: str = ""
    load_explains: bool = True
    states: Mapping[str, float] = field(default_factory=dict)
    unnamed: str = ""
    significance: float = SIGNIFICANCE

    @property
    def is_significant(self) -> bool:
        """Whether the test departs."""
        return self.probability < self.significance

    @property
    def is_named(self) -> bool:
        """Whether the most probable state is a labelled one."""
        return next(iter(self.states), HEALTHY) not in (HEALTHY, NONE_OF_THESE)

    @property
    def likeness(self) -> str:
        """The probable states in words, or why none is named."""
        probable = [
            f"{name} ({share:.0%})" for name, share in self.states.items() if share >= _SAID
        ]
        if not probable:
            return self.unnamed
        verb = "state is" if len(probable) == 1 else "states are"
        return f"the most probable labelled {verb} {', '.join(probable)}".replace("%)", " %)")

    def __str__(self) -> str:
        if not self.is_significant:
            return "no figure departs"
        named = "; ".join(map(str, self.changes[:_MOST_NAMED]))
        words = f"departed ({_share(self.probability)} differs as much): {named}"
        return "; ".join(filter(None, [words, self.likeness]))


def departure_of(
    tested: DatedFigures,
    healthy: Sequence[DatedFigures],
    figures: Mapping[str, JudgedFigure],
    significance: float = SIGNIFICANCE,
) -> Departure:
    """Return how unlikely a test is for a unit with these healthy tests.

    Parameters
    ----------
    tested, healthy
        The test, and the healthy tests of the unit.
    figures
        Figures to compare, by name; those that one of the tests lacks do not count.
    significance
        Probability of a healthy test below which the test departs.

    Raises
    ------
    ValueError
        When there are fewer than ``FEWEST`` healthy tests, or no figure is in all tests.
    """
    if len(healthy) < FEWEST:
        raise ValueError(
            f"{len(healthy)} healthy tests: expected {FEWEST} or more, to see their scatter"
        )
    names = [name for name in figures if all(name in test.values for test in (tested, *healthy))]
    if not names:
        raise ValueError("the test and the healthy tests have no figure in common")
    chosen = {name: figures[name] for name in names}
    # Bonferroni: for each figure.
    limit = significance / len(names)
    changes = _changes(tested, healthy, chosen, limit)
    departure = _departure(changes, significance)
    days = {test.day for test in healthy}
    if departure.is_significant or tested.day in days:
        return departure
    nearest = min(days, key=lambda day: abs(day - tested.day))
    first = _changes(tested._replace(day=nearest), healthy, chosen, limit)[0]
    if first.probability >= limit:
        return departure
    on_its_day = next(change for change in changes if change.name == first.name)
    return replace(
        departure,
        remark=f"{first.figure.label} differs by {first.change_text}; on a day without healthy "
        f"tests, changes above {on_its_day.smallest_text} would show",
    )


def _departure(changes: Sequence[Change], significance: float) -> Departure:
    count = len(changes)
    significant = tuple(change for change in changes if count * change.probability < significance)
    probability = min(1.0, count * changes[0].probability)
    return Departure(probability, significant, significance=significance)


def _changes(
    tested: DatedFigures,
    healthy: Sequence[DatedFigures],
    figures: Mapping[str, JudgedFigure],
    limit: float,
) -> list[Change]:
    """Return the change of each figure, the least probable first."""
    return sorted(
        (_change(name, tested, healthy, figures, limit) for name in figures),
        key=lambda change: change.probability,
    )


def _change(
    name: str,
    tested: DatedFigures,
    healthy: Sequence[DatedFigures],
    figures: Mapping[str, JudgedFigure],
    limit: float,
) -> Change:
    """Return the change of a figure; ``limit`` is the probability below which it departs."""
    figure = figures[name]
    unit = 1.0 if figure.is_logarithm else _largest_level(healthy, figures)
    error = figure.error * unit
    observed = tuple(Observation(test.values[name], error, test.day) for test in healthy)
    scatter = _scatter(observed, figure.between_days * unit)
    test = SingleTest.of(Observation(tested.values[name], error, tested.day), scatter)
    return Change(name, figure, test, test.probability, limit)


@lru_cache(_KEPT_SCATTERS)
def _scatter(healthy: tuple[Observation, ...], between_days: float) -> Scatter:
    """Return the scatter of a figure; every test of a unit is compared with the same few."""
    # The prior reaches only some times its median, and must cover the scatter of the healthy tests.
    shown = float(np.std([observation.value for observation in healthy], ddof=1))
    return scatter_of(healthy, max(between_days, shown, _TINY))


def _largest_level(healthy: Sequence[DatedFigures], figures: Mapping[str, JudgedFigure]) -> float:
    levels = (name for name, figure in figures.items() if not figure.is_logarithm)
    return max(abs(float(np.mean([test.values[name] for test in healthy]))) for name in levels)


def _share(probability: float) -> str:
    """Return how many healthy tests are as unlikely, in words."""
    least = max(probability, _LEAST_SAID)
    number = float(f"{1.0 / least:.2g}")
    return f"{'at most ' if probability < least else ''}1 in {number:,.0f} healthy tests"
