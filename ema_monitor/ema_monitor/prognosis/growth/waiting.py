"""Whether a fault is judged to grow, and what a life that is not given yet waits for."""

import math
from typing import Final

from ema_core.wording import counted
from ema_monitor.prognosis.growth.cells import CONSTANT_PRIOR
from ema_monitor.prognosis.growth.settings import TrackerSettings

NOT_SHOWN: Final = "fewer than two tests that agree so far"
"""Why a fault that no test has shown has no life."""

LEAST_TESTS: Final = 5
"""Tests of a level below which no component newly counts as growing."""
BEGINS_BELOW: Final = 1e-4
"""Probability of no growth below which a component counts as growing [-].

Of a component that does not grow, the probability that this ever happens is of the same size,
however long it is monitored (Ville's inequality for likelihood ratios).
"""
ENDS_ABOVE: Final = 0.2
"""Probability of no growth above which it no longer is [-]."""

_LIKELY: Final = 0.5
_LEAST: Final = 1e-300
_MOST_TESTS: Final = 1000


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
