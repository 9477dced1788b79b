"""Estimates of each component, its remaining useful life, and the evidence still missing."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_core.wording import counted, text_table
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.duty.course import FutureDuty
from ema_monitor.prognosis.growth.cells import CONSTANT_PRIOR
from ema_monitor.prognosis.growth.check import TrackRecord
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings

NOT_SHOWN: Final = "fewer than two tests that agree so far"
"""Why a fault that no test has shown has no life."""

LEAST_TESTS: Final = 5
"""Tests of a level below which no component newly counts as growing, and tests after a repair
before which no life is given."""
BEGINS_BELOW: Final = 1e-4
"""Probability of no growth below which a component counts as growing [-].

Of a component that does not grow, the probability that this ever happens is of the same size,
however long it is monitored (Ville's inequality for likelihood ratios).
"""
ENDS_ABOVE: Final = 0.2
"""Probability of no growth above which it no longer is [-]."""

FAN_LEVELS: Final = (0.05, 0.5, 0.95)
"""Probabilities of the quantiles of a ``Fan`` [-]."""

_LIKELY: Final = 0.5
_LEAST: Final = 1e-300
_MOST_TESTS: Final = 1000
_ANY_LIMIT: Final = "first fault limit"


@dataclass(frozen=True)
class TrackedFault:
    """Estimate of one component."""

    name: str
    """Component of the fault vector."""
    tests: int
    """Number of tests that showed it."""
    value: float
    sigma: float
    """Mean and standard deviation, in the units of the fault vector [-]; NaN before any test."""
    trend: float
    """Growth of the value [1/h]."""
    calibration: TrackRecord
    """How its predictions held against the tests so far."""


@dataclass(frozen=True)
class RemainingLife:
    """Quantiles of the remaining useful life under one criterion."""

    known: bool
    """Whether a figure can be given."""
    hours_05: float
    hours_50: float
    hours_95: float
    """5 %, 50 % and 95 % quantiles from the latest test on [h]; NaN when not known."""
    criterion: str
    """What ends life."""
    reason: str = ""
    """Why no figure can be given; empty when known."""

    @classmethod
    def unknown(cls, criterion: str, reason: str) -> "RemainingLife":
        """Return an unknown life, with the reason."""
        return cls(False, math.nan, math.nan, math.nan, criterion, reason)

    @classmethod
    def of_samples(cls, hours: Array, criterion: str) -> "RemainingLife":
        """Return the quantiles of samples of a life [h], ``(n,)``."""
        low, median, high = np.quantile(hours, [0.05, 0.5, 0.95], method="inverted_cdf")
        return cls(True, float(low), float(median), float(high), criterion)


@dataclass(frozen=True, eq=False)
class Prognosis:
    """Remaining useful life of an actuator, from its latest test on."""

    hours: float
    """Service hour of the latest test [h]; NaN when there was none."""
    components: Mapping[str, RemainingLife]
    """Life until each component reaches its limit, by name."""
    overall: RemainingLife
    """Life until the first of them does."""
    dominant_fault: str
    """Component that does so first most often; empty when none is known to grow."""
    samples: Array
    """Samples of the overall life [h], ``(n,)``; infinite when it is not known."""
    future: FutureDuty
    """What is assumed of the duty to come."""
    levels: Array = field(default_factory=lambda: np.empty(0))
    """Present distance of the dominant fault from healthy in each sample [-], ``(n,)``; empty when
    there is no dominant one."""

    @classmethod
    def unknown(cls, reason: str, limits: HealthLimits, duty: FutureDuty) -> "Prognosis":
        """Return a prognosis without figures, with the reason."""
        components = {
            name: RemainingLife.unknown(_criterion(name, limits.of(name)), reason)
            for name in COMPONENTS
        }
        overall = RemainingLife.unknown(_ANY_LIMIT, reason)
        return cls(math.nan, components, overall, "", np.empty(0), duty)

    def as_rows(self) -> list[dict[str, Any]]:
        """Return a table of plain values: a row a component, and one for the first of them."""
        return [asdict(life) for life in (*self.components.values(), self.overall)]

    def __str__(self) -> str:
        lives = {life.criterion: life for life in self.components.values()}
        lives["the first of these"] = self.overall
        rows = [
            (
                criterion,
                *(f"{hours:.0f}" for hours in (life.hours_05, life.hours_50, life.hours_95)),
                life.reason,
            )
            for criterion, life in lives.items()
        ]
        table = text_table(("until", "5 %", "50 %", "95 %", ""), rows)
        return f"remaining useful life from {self.hours:g} h on [h], {self.future}\n{table}"


@dataclass(frozen=True, eq=False)
class Fan:
    """Quantiles of the future of each component, for plots."""

    hours: Array
    """Hours from the latest test on [h], ``(m,)``."""
    values: Mapping[str, Array]
    """Fault values by component [-], ``(3, m)`` each."""


def prognosis_of(
    at_hours: float,
    samples: Array,
    is_shown: Flags,
    reasons: Sequence[str],
    limits: HealthLimits,
    duty: FutureDuty,
    levels: Array,
) -> Prognosis:
    """Return the prognosis by samples of lives, with quantiles where they can be given.

    Once the life of one component is known, the overall one counts all that a test has shown, each
    as probable as its growth is: growth that is nearly certain must not come as a surprise. Samples
    and present levels are ``(7, n)``; a reason is empty where a life can be given.
    """
    components = {
        name: RemainingLife.unknown(criterion, reason)
        if reason
        else RemainingLife.of_samples(component_lives, criterion)
        for name, component_lives, reason in zip(COMPONENTS, samples, reasons, strict=True)
        for criterion in [_criterion(name, limits.of(name))]
    }
    every = np.where(is_shown[:, None], samples, np.inf)
    if not all(reasons):
        counts = np.bincount(every.argmin(axis=0), minlength=len(COMPONENTS))
        number = int(counts.argmax())
        dominant, first, own_levels = COMPONENTS[number], every.min(axis=0), levels[number]
        overall = RemainingLife.of_samples(first, components[dominant].criterion)
    else:
        dominant, first, own_levels = "", np.full(samples.shape[1], np.inf), np.empty(0)
        overall = RemainingLife.unknown(_ANY_LIMIT, "; ".join(sorted(set(reasons))))
    return Prognosis(at_hours, components, overall, dominant, first, duty, own_levels)


def _criterion(name: str, limit: float) -> str:
    """Return in words when a fault ends life."""
    fault = FAULTS[FAULT_NAMES.index(name)]
    if fault.is_two_sided:
        return f"{fault.label} differs from {fault.healthy:g} by more than {limit:g}"
    return f"{fault.label} exceeds {limit:g}"


def growth_not_certain(constant: float, tests: int) -> str:
    """Return why a fault is not judged to grow.

    Evidence grows faster the longer growth lasts, so that fewer tests than it names may do.
    ``constant`` is the probability that it does not grow, after some tests of its level.
    """
    if constant >= _LIKELY:
        return "no significant growth"
    log = math.log(max(constant, _LEAST))
    pace = (math.log(CONSTANT_PRIOR) - log) / max(tests, 1)
    missing = (log - math.log(BEGINS_BELOW)) / pace if pace > 0.0 else 0
    more = max(math.ceil(missing), LEAST_TESTS - tests, 1)
    return f"growth is not certain yet: its probability is {1.0 - constant:.3f}{_after(more)}"


def too_soon_after(repair_hours: float, missing: int) -> str:
    """Return why no life is given after a fault fell at a service hour [h]; tests are missing.

    A new baseline makes a fault fall as a repair does.
    """
    since = f"fewer than {LEAST_TESTS} tests since the repair or new baseline"
    since += f" at {repair_hours:,.0f} h"
    return since + _after(missing)


def beyond_horizon(
    median_hours: float, observed_hours: float, tests: int, settings: TrackerSettings
) -> str:
    """Return why a life that ends late is not given; empty when it is.

    The fault has been observed over some hours [h], in some tests.
    """
    horizon = min(settings.horizon_hours, settings.horizon_factor * observed_hours)
    if median_hours <= horizon:
        return ""
    reason = f"limit not within the horizon of {horizon:.0f} h"
    if tests < 2 or observed_hours <= 0.0 or not median_hours <= settings.horizon_hours:
        return reason
    # What is observed grows as life goes by: u + d = (median - d) / factor.
    until = (median_hours / settings.horizon_factor - observed_hours) / (
        1.0 + 1.0 / settings.horizon_factor
    )
    return reason + _after(max(math.ceil(until * (tests - 1) / observed_hours), 1))


def _after(tests: int) -> str:
    """Return after how many more tests this is likely to have changed; empty for very many."""
    return "" if tests > _MOST_TESTS else f" (about {counted(tests, 'more test')})"
