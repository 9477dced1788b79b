"""What is to come after a test: quantiles of the faults, as far as life is likely to last."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.prediction import Fan, RemainingLife
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.outlook import Outlook

LEVELS: Final = (0.05, 0.5, 0.95)
"""Probabilities of the quantiles of a forecast [-]."""

_TIMES: Final = 30
_LEAST_SPAN_HOURS: Final = 1.0


@dataclass(frozen=True, eq=False)
class Forecaster:
    """What is known of a unit after a test, and does not change with later ones.

    Attributes
    ----------
    outlook
        Health and life after the test.
    tracker
        What is known of growth; None when the service hours are unknown.
    limits
        Where the life of each fault ends.
    observed_hours
        Hours over which the unit has been observed [h].
    horizon_hours
        Longest life that is looked ahead [h].
    missing_share
        Probability that a test gives no valid estimate [-].
    """

    outlook: Outlook
    tracker: Tracker | None
    limits: HealthLimits
    observed_hours: float
    horizon_hours: float
    missing_share: float

    def fan(self) -> Fan | None:
        """Return quantiles of the faults to come; None when the service hours are unknown."""
        if self.tracker is None:
            return None
        ahead = hours_ahead(self.outlook.rul, self.observed_hours)
        hours = ahead * np.linspace(0.0, 1.0, _TIMES)
        return self.tracker.fan(hours, LEVELS, self.outlook.future)


def hours_ahead(life: RemainingLife, observed_hours: float) -> float:
    """Return how far ahead a life is shown: behind its likely end, if that is not far away [h].

    Parameters
    ----------
    life
        The remaining life.
    observed_hours
        Hours over which the unit has been observed [h].
    """
    span = max(observed_hours, _LEAST_SPAN_HOURS)
    ahead = min(1.1 * life.hours_95, 2.5 * life.hours_50, 2.0 * span) if life.known else 0.0
    return max(ahead, 0.06 * span)
