# SPDX-License-Identifier: Apache-2.0
"""Departure of a test from the healthy tests of its unit, by its model-free figures.

Each figure is compared with its prediction from the healthy tests (``single``). The Bonferroni
correction for the number of figures is also valid for dependent figures.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from ema_monitor.joint.scatter import Scatter
from ema_monitor.joint.single import POWER, SIGNIFICANCE, Observation, SingleTest, scatter_of
from ema_monitor.reasons import (
    DepartedFigure,
    FiguresDeparted,
    LabelledState,
    StateProbability,
    StateUnnamed,
    WouldDepart,
)

HEALTHY: Final = "healthy"
"""State of the tests and records of a baseline."""

NONE_OF_THESE: Final = "none of these"
"""State of a test or record that resembles no labelled state."""

FEWEST: Final = 3
"""Minimum number of tests or records of a state that is compared."""

_CACHED_SCATTERS: Final = 1024
_TINY: Final = 1e-12


class JudgedFigure(NamedTuple):
    """Kind, prior scatter and error of a model-free figure."""

    between_days: float
    """Prior median of the standard deviation between days [-]; for a level, relative to the largest
    healthy level."""
    is_logarithm: bool = True
    """Whether the figure is a logarithm; otherwise it is a level [A]."""
    error: float = 0.0
    """Standard deviation of the figure's error in one test, in the unit of ``between_days``. It is
    larger than the scatter of healthy tests in quick succession."""


class DatedFigures(NamedTuple):
    """Day of a test, counted from 1970-01-01, and its figures by name."""

    day: int
    values: Mapping[str, float]


class Change(NamedTuple):
    """Difference of a figure from its prediction."""

    name: str
    """Name of the figure."""
    figure: JudgedFigure
    """Kind and prior scatter of the figure."""
    test: SingleTest
    """Value of the figure, and its prediction from the healthy tests."""
    probability: float
    """Probability that the figure differs at least as much in a healthy test."""
    limit: float
    """Probability below which the figure departs."""

    @property
    def healthy(self) -> float:
        """Value predicted from the healthy tests."""
        return self.test.prediction.mean

    @property
    def smallest_change(self) -> float:
        """Smallest change of the figure that is detected with a probability of 90 %."""
        return self.test.prediction.smallest_change(self.limit, POWER)

    @property
    def departed(self) -> DepartedFigure:
        """Ratio of the figure to its healthy value; for a level, both values as well."""
        if self.figure.is_logarithm:
            return DepartedFigure(self.name, math.exp(self.test.change))
        ratio = self.test.value / self.healthy if self.healthy > 0.0 else math.nan
        return DepartedFigure(self.name, ratio, self.test.value, self.healthy)

    @property
    def _has_ratio(self) -> bool:
        return self.figure.is_logarithm or self.healthy > 0.0

    def _shown(self, change: float) -> float:
        """Return a change relative to a positive healthy value [-], else in A."""
        if self.figure.is_logarithm:
            return math.expm1(change)
        return change / self.healthy if self._has_ratio else change

    def would_depart(self, smallest_change: float) -> WouldDepart:
        """Return the figure as a figure that would depart on a day with healthy tests.

        ``smallest_change`` is the smallest change of the figure that is detected on the day of the
        test.
        """
        shown = self._shown(self.test.change), self._shown(smallest_change)
        return WouldDepart(self.name, *shown, self._has_ratio)


@dataclass(frozen=True)
class Departure:
    """Departure of a test from the healthy tests of its unit."""

    probability: float
    """Probability that any figure differs at least as much in a healthy test."""
    changes: tuple[Change, ...] = ()
    """Figures that depart, the most significant first."""
    would_depart: WouldDepart | None = None
    """Figure that would depart if there were healthy tests on the same day, or None."""
    load_explains: bool = True
    """Whether a changed load may explain the departure."""
    states: Mapping[str, float] = field(default_factory=dict)
    """Probabilities of the labelled states and of ``NONE_OF_THESE``, the largest first; empty if no
    states are compared."""
    unnamed: StateUnnamed | None = None
    """Reason why ``states`` is empty although the unit has labelled states."""
    significance: float = SIGNIFICANCE
    """Probability below which the test departs."""

    @property
    def is_significant(self) -> bool:
        """Whether the test departs significantly from the healthy tests."""
        return self.probability < self.significance

    @property
    def is_named(self) -> bool:
        """Whether the most probable state is a labelled state."""
        return next(iter(self.states), HEALTHY) not in (HEALTHY, NONE_OF_THESE)

    @property
    def likeness(self) -> LabelledState | StateUnnamed | None:
        """The probable states, or the reason why no state is named; None without labels."""
        if not self.states:
            return self.unnamed
        return LabelledState(tuple(StateProbability(*item) for item in self.states.items()))

    @property
    def reason(self) -> FiguresDeparted:
        """Reason for the verdict: the figures depart, and no fault explains the departure."""
        departed = tuple(change.departed for change in self.changes)
        return FiguresDeparted(departed, self.probability)


def departure_of(
    tested: DatedFigures,
    healthy: Sequence[DatedFigures],
    figures: Mapping[str, JudgedFigure],
    significance: float = SIGNIFICANCE,
) -> Departure:
    """Return the departure of a test from the healthy tests of its unit.

    If the test does not depart and its day has no healthy tests, it is also compared as a test of
    the nearest day with healthy tests (``would_depart``).

    Parameters
    ----------
    tested, healthy
        The test, and the healthy tests of the unit.
    figures
        Figures to compare, by name. A figure that any test lacks is ignored.
    significance
        Probability under the healthy tests below which the test departs.

    Raises
    ------
    ValueError
        If there are fewer than ``FEWEST`` healthy tests, or no figure is common to all tests.
    """
    if len(healthy) < FEWEST:
        raise ValueError(
            f"{len(healthy)} healthy tests: expected {FEWEST} or more, to estimate their scatter"
        )
    names = [name for name in figures if all(name in test.values for test in (tested, *healthy))]
    if not names:
        raise ValueError("the test and the healthy tests have no figure in common")
    chosen = {name: figures[name] for name in names}
    # Bonferroni correction for the number of figures.
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
    return replace(departure, would_depart=first.would_depart(on_its_day.smallest_change))


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
    """Return the change of each figure, the most significant first."""
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


@lru_cache(_CACHED_SCATTERS)
def _scatter(healthy: tuple[Observation, ...], between_days: float) -> Scatter:
    """Return the scatter model of a figure; it is cached because all tests of a unit share it."""
    # The prior extends to a few times its median, and must cover the scatter of the healthy tests.
    shown = float(np.std([observation.value for observation in healthy], ddof=1))
    return scatter_of(healthy, max(between_days, shown, _TINY))


def _largest_level(healthy: Sequence[DatedFigures], figures: Mapping[str, JudgedFigure]) -> float:
    levels = (name for name, figure in figures.items() if not figure.is_logarithm)
    return max(abs(float(np.mean([test.values[name] for test in healthy]))) for name in levels)
