"""By when to remove a unit, at the risk that its operator accepts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.service import TimedTest

_QUANTILE: Final = 0.05
_RECENT_NS: Final = 90 * 86_400 * 1_000_000_000
_LEAST_NS: Final = 86_400 * 1_000_000_000
_MOST_HOURS_A_DAY: Final = 24.0
_DAY_NS: Final = 86_400e9


@dataclass(frozen=True)
class Removal:
    """By when to remove a unit (P27).

    Attributes
    ----------
    risk
        Probability of a failure before that is accepted [-].
    hours
        Flight hours from the latest test on [h]; NaN when the remaining life is unknown.
    cycles
        The same in test cycles; NaN when hours per cycle are unknown too.
    days
        The same in days of the calendar, at the present usage; NaN when that is unknown too.
    hours_a_day
        The present usage [h/d].
    """

    risk: float = _QUANTILE
    hours: float = math.nan
    cycles: float = math.nan
    days: float = math.nan
    hours_a_day: float = math.nan


def removal_of(
    life: RemainingLife,
    lifetimes: NDArray[np.float64],
    risk: float,
    hours_per_cycle: float,
    hours_a_day: float,
) -> Removal:
    """Return by when to remove a unit.

    Parameters
    ----------
    life
        Its remaining life.
    lifetimes
        Equally probable remaining lives [h], ``(n,)``; empty when it is unknown.
    risk
        Probability of a failure before that is accepted [-].
    hours_per_cycle, hours_a_day
        Flight hours of a test cycle [h] and of a day [h/d]; NaN when unknown.
    """
    if not life.known or not lifetimes.size:
        return Removal(risk, hours_a_day=hours_a_day)
    hours = float(np.quantile(lifetimes, risk, method="inverted_cdf"))
    # The published quantiles may rest on fewer samples, and never contradict this.
    if risk <= _QUANTILE:
        hours = min(hours, life.hours_05)
    if risk >= _QUANTILE:
        hours = max(hours, life.hours_05)
    return Removal(risk, hours, hours / hours_per_cycle, hours / hours_a_day, hours_a_day)


def usage_of(used: Sequence[TimedTest]) -> float:
    """Return the present usage [h/d]: that of the last 90 days, as far as there are tests.

    NaN when the tests do not span a day, or when more hours than a day has would be flown in one:
    on a test bench, or in a simulation, stamps and service hours are not of one clock.

    Parameters
    ----------
    used
        Tests whose service hours are known, in ascending order of these.
    """
    if not used:
        return math.nan
    last = used[-1]
    latest_ns = np.maximum.accumulate([test.stamp_ns for test in used])
    first = used[int(np.searchsorted(latest_ns, last.stamp_ns - _RECENT_NS))]
    span_ns = last.stamp_ns - first.stamp_ns
    if span_ns < _LEAST_NS:
        return math.nan
    rate = (last.hours - first.hours) / (span_ns / _DAY_NS)
    return rate if 0.0 < rate <= _MOST_HOURS_A_DAY else math.nan
