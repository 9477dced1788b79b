"""By when to remove a unit, at the risk that is accepted."""

import math

import numpy as np
import pytest

from ema_monitor.prognosis.forecaster import removal_of
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.service import ServiceHours, TimedTest

from .made_tests import FIRST_NS

LIVES = np.random.default_rng(0).permutation(np.arange(1.0, 1001.0))
LIFE = RemainingLife(True, 50.0, 500.0, 950.0, "friction exceeds 0.5")
DAY_NS = 86_400_000_000_000


def usage(*days_and_hours: tuple[float, float]) -> float:
    """The usage by tests at days of the calendar and service hours."""
    service = ServiceHours()
    service.used = [
        TimedTest(FIRST_NS + int(day * DAY_NS), hours, number, True)
        for number, (day, hours) in enumerate(days_and_hours)
    ]
    return service.usage


@pytest.mark.parametrize(("risk", "hours"), [(0.01, 10.0), (0.05, 50.0), (0.2, 200.0)])
def test_as_many_units_fail_before_as_is_accepted(risk: float, hours: float):
    removal = removal_of(LIFE, LIVES, risk, hours_per_cycle=2.0, hours_a_day=8.0)
    assert removal.hours == hours
    assert np.mean(removal.hours > LIVES) < risk <= np.mean(removal.hours >= LIVES)
    assert (removal.cycles, removal.days) == (hours / 2.0, hours / 8.0)


def test_published_quantiles_are_not_contradicted():
    # They may rest on other samples: a lower risk is never later than the 5 % quantile.
    life = RemainingLife(True, 8.0, 500.0, 950.0, "")
    assert removal_of(life, LIVES, 0.01, math.nan, math.nan).hours == 8.0
    assert removal_of(life, LIVES, 0.05, math.nan, math.nan).hours == 8.0
    late = RemainingLife(True, 300.0, 500.0, 950.0, "")
    assert removal_of(late, LIVES, 0.2, math.nan, math.nan).hours == 300.0


def test_what_is_unknown_stays_unknown():
    unknown = removal_of(RemainingLife.unknown("", "why"), np.empty(0), 0.05, 2.0, 8.0)
    assert all(map(math.isnan, (unknown.hours, unknown.cycles, unknown.days)))
    known = removal_of(LIFE, LIVES, 0.05, math.nan, math.nan)
    assert known.hours == 50.0
    assert all(map(math.isnan, (known.cycles, known.days)))


def test_usage_is_that_of_the_last_ninety_days():
    # 10 h a day at first, 4 h a day since.
    days = ((0, 0), (100, 1000), (150, 1200), (200, 1400))
    assert usage(*days) == pytest.approx(4.0)
    assert usage(*days[:2]) == pytest.approx(math.nan, nan_ok=True)


@pytest.mark.parametrize(
    "used", [(), ((0, 0),), ((0, 0), (0.5, 4)), ((0, 0), (2, 100)), ((0, 5), (3, 5))]
)
def test_usage_is_unknown_without_a_day_or_where_the_clocks_are_not_one(used):
    assert math.isnan(usage(*used))
