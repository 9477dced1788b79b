# SPDX-License-Identifier: Apache-2.0
"""Fault estimates, remaining useful lives, and reasons why a life is unknown."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np

from ema_core.arrays import Array, Flags
from ema_core.display import Displayed
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_core.wording import counted, text_table
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.duty.course import FutureDuty
from ema_monitor.prognosis.growth.cells import CONSTANT_PRIOR
from ema_monitor.prognosis.growth.check import TrackRecord
from ema_monitor.prognosis.growth.tracker_settings import TrackerSettings

NOT_SHOWN: Final = "fewer than two tests agree so far"
"""Reason given if no test has shown the fault."""

LEAST_TESTS: Final = 5
"""Smallest number of tests to consider a component growing, and to predict a life after a
repair."""
BEGINS_BELOW: Final = 1e-4
"""Probability of no growth below which a component is considered growing [-].

The false alarm probability over any length of monitoring is of the same order (Ville's inequality
for likelihood ratios).
"""
ENDS_ABOVE: Final = 0.2
"""Probability of no growth above which a component stops being considered growing [-]."""

FAN_LEVELS: Final = (0.05, 0.5, 0.95)
"""Quantile levels of a ``Fan`` [-]."""

_LIKELY: Final = 0.5
_LEAST: Final = 1e-300
_MOST_TESTS: Final = 1000
_ANY_LIMIT: Final = "first fault limit"


@dataclass(frozen=True)
class TrackedFault:
    """Tracked estimate of one component."""

    name: str
    """Component of the fault vector."""
    tests: int
    """Number of tests used for the component."""
    value: float
    sigma: float
    """Mean and standard deviation in the units of the fault vector [-]; NaN before the first
    test."""
    trend: float
    """Growth rate of the value [1/h]; NaN before the first test."""
    track_record: TrackRecord
    """Scores of the component's past predictions."""


@dataclass(frozen=True)
class RemainingLife:
    """Quantiles of the remaining useful life for one end-of-life criterion."""

    known: bool
    """Whether the life is known."""
    hours_05: float
    hours_50: float
    hours_95: float
    """5, 50 and 95 % quantiles, counted from the latest test [h]; NaN if unknown."""
    criterion: str
    """End-of-life criterion, as a phrase."""
    reason: str = ""
    """Reason why the life is unknown; empty if known."""

    @property
    def brief(self) -> str:
        """Quantiles of the life, or "unknown"."""
        if not self.known:
            return "unknown"
        hours = (self.hours_05, self.hours_50, self.hours_95)
        return f"{' / '.join(f'{quantile:.4g}' for quantile in hours)} h (5 / 50 / 95 %)"

    @classmethod
    def unknown(cls, criterion: str, reason: str) -> "RemainingLife":
        """Return an unknown life with a reason."""
        return cls(False, math.nan, math.nan, math.nan, criterion, reason)

    @classmethod
    def of_samples(cls, hours: Array, criterion: str) -> "RemainingLife":
        """Return a known life with the quantiles of samples, ``(n,)`` [h]."""
        low, median, high = np.quantile(hours, [0.05, 0.5, 0.95], method="inverted_cdf")
        return cls(True, float(low), float(median), float(high), criterion)


@dataclass(frozen=True, eq=False, repr=False)
class Prognosis(Displayed):
    """Remaining useful life of an actuator, counted from its latest test."""

    hours: float
    """Service hour of the latest test [h]; NaN before the first test or if it is unknown."""
    components: Mapping[str, RemainingLife]
    """Life until each component reaches its limit, by component name."""
    overall: RemainingLife
    """Life until the first component reaches its limit."""
    dominant_fault: str
    """Component that most often reaches its limit first; empty if no component has a known life."""
    samples: Array
    """Samples of the overall life, ``(n,)`` [h].

    Infinite if no component has a known life; empty if the service hours are unknown.
    """
    future: FutureDuty
    """Assumed future duty."""
    levels: Array = field(default_factory=lambda: np.empty(0))
    """Current distance of the dominant fault from healthy in each sample, ``(n,)`` [-].

    Empty if there is no dominant fault.
    """

    @classmethod
    def unknown(cls, reason: str, limits: HealthLimits, duty: FutureDuty) -> "Prognosis":
        """Return an unknown prognosis with a reason."""
        components = {
            name: RemainingLife.unknown(_criterion(name, limits.of(name)), reason)
            for name in COMPONENTS
        }
        overall = RemainingLife.unknown(_ANY_LIMIT, reason)
        return cls(math.nan, components, overall, "", np.empty(0), duty)

    @property
    def brief(self) -> str:
        """Overall life and, if known, the service hour of the latest test."""
        return f"remaining life {self.overall.brief}{self._moment}"

    @property
    def _moment(self) -> str:
        return "" if math.isnan(self.hours) else f" after {self.hours:g} h"

    def as_rows(self) -> list[dict[str, Any]]:
        """Return the lives as a list of dicts: each component, then the overall life."""
        return [asdict(life) for life in (*self.components.values(), self.overall)]

    def __str__(self) -> str:
        lives = {life.criterion: life for life in self.components.values()}
        lives["first of these"] = self.overall
        rows = [
            (
                criterion,
                *(f"{hours:.0f}" for hours in (life.hours_05, life.hours_50, life.hours_95)),
                life.reason,
            )
            for criterion, life in lives.items()
        ]
        table = text_table(("until", "5 %", "50 %", "95 %", ""), rows)
        return f"remaining useful life{self._moment} [h], {self.future}\n{table}"


@dataclass(frozen=True, eq=False)
class Fan:
    """Quantiles of the future fault values, for fan charts."""

    hours: Array
    """Hours from the latest test, ``(m,)`` [h]."""
    values: Mapping[str, Array]
    """Fault values by component, ``(3, m)`` each [-]."""


def prognosis_of(
    at_hours: float,
    samples: Array,
    is_shown: Flags,
    reasons: Sequence[str],
    limits: HealthLimits,
    duty: FutureDuty,
    levels: Array,
) -> Prognosis:
    """Return the prognosis computed from samples of component lives.

    If the life of any component is known, the overall life includes every component that a test has
    shown, weighted by its probability of growth, so that nearly certain growth is not ignored.

    Parameters
    ----------
    at_hours
        Service hour of the latest test [h].
    samples
        Samples of the life of each component, ``(7, n)`` [h].
    is_shown
        Whether a test has shown each component, ``(7,)``.
    reasons
        Reason why the life of each component is unknown; empty if known.
    limits
        End-of-life limits.
    duty
        Assumed future duty.
    levels
        Current distances from healthy in the samples, ``(7, n)`` [-].
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
    """Return the end-of-life criterion of a fault as a phrase."""
    fault = FAULTS[FAULT_NAMES.index(name)]
    if fault.is_two_sided:
        return f"{fault.label} differs from {fault.healthy:g} by more than {limit:g}"
    return f"{fault.label} exceeds {limit:g}"


def growth_not_certain(constant: float, tests: int) -> str:
    """Return why a fault is not considered to be growing.

    If growth is more likely than not, the reason also gives the approximate number of further tests
    that are needed, unless it is very large. This number is conservative: evidence accumulates
    faster the longer growth lasts.

    Parameters
    ----------
    constant
        Probability that the fault does not grow [-].
    tests
        Number of tests used since the level was last reset.
    """
    if constant >= _LIKELY:
        return "no significant growth"
    log = math.log(max(constant, _LEAST))
    pace = (math.log(CONSTANT_PRIOR) - log) / max(tests, 1)
    missing = (log - math.log(BEGINS_BELOW)) / pace if pace > 0.0 else 0
    more = max(math.ceil(missing), LEAST_TESTS - tests, 1)
    return f"growth is not certain yet: its probability is {1.0 - constant:.3f}{_after(more)}"


def too_soon_after(repair_hours: float, missing: int) -> str:
    """Return why no life is predicted soon after a repair or a new baseline.

    Parameters
    ----------
    repair_hours
        Service hour at which the fault decreased [h].
    missing
        Number of further tests needed.
    """
    since = f"fewer than {LEAST_TESTS} tests since the repair or new baseline"
    since += f" at {repair_hours:,.0f} h"
    return since + _after(missing)


def beyond_horizon(
    median_hours: float, observed_hours: float, tests: int, settings: TrackerSettings
) -> str:
    """Return why a life beyond the horizon is not published; "" for a life within the horizon.

    Parameters
    ----------
    median_hours
        Median of the life [h].
    observed_hours, tests
        Hours over which the fault has been observed [h], and number of tests used.
    settings
        Settings with the horizon.
    """
    horizon = min(settings.horizon_hours, settings.horizon_factor * observed_hours)
    if median_hours <= horizon:
        return ""
    reason = f"limit not within the horizon of {horizon:.0f} h"
    if tests < 2 or observed_hours <= 0.0 or not median_hours <= settings.horizon_hours:
        return reason
    # The horizon reaches the end of life after d more hours: u + d = (median - d) / factor.
    until = (median_hours / settings.horizon_factor - observed_hours) / (
        1.0 + 1.0 / settings.horizon_factor
    )
    return reason + _after(max(math.ceil(until * (tests - 1) / observed_hours), 1))


def _after(tests: int) -> str:
    """Return a phrase with the number of tests still needed; "" above ``_MOST_TESTS``."""
    return "" if tests > _MOST_TESTS else f" (about {counted(tests, 'more test')})"
