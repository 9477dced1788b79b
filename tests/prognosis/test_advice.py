# SPDX-License-Identifier: Apache-2.0
"""Outlook after a test: forecast, removal, the cheapest advice, and their texts."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from ema_core.levels import ERROR, OK, STALE, WARN
from ema_monitor.health import FaultHealth, Health
from ema_monitor.prognosis.advice import Costs, Decision, advise
from ema_monitor.prognosis.forecaster import Forecaster, earlier, hours_ahead, removal_of
from ema_monitor.prognosis.growth.prediction import Fan, RemainingLife
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.outlook import Outlook, Removal, unknown_outlook
from ema_monitor.prognosis.sentences import cause_of_level, removal_text
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .lived_units import TEN_HOURS
from .made_tests import made_test

LIVES = np.random.default_rng(0).permutation(np.arange(1.0, 1001.0))
LIFETIME = RemainingLife(True, 50.0, 500.0, 950.0, "friction exceeds 0.5")


class Life(NamedTuple):
    """A unit whose friction reaches 0.5 at test 45, 460 h after the count began.

    It has the outlooks after each of fifty tests, a forecaster after thirty tests with its forecast
    at that time, and a forecaster that was requested too late.
    """

    outlooks: list[Outlook]
    forecaster: Forecaster
    fan: Fan
    asked_late: Forecaster | None


@pytest.fixture(scope="module")
def life() -> Life:
    unit = Unit(History("flap", "0001"), TEN_HOURS)
    outlooks = grow(unit, range(30))
    kept, twin = unit.forecaster(outlooks[-1]), unit.forecaster(outlooks[-1])
    assert kept is not None
    assert twin is not None
    fan = twin.fan()
    assert fan is not None
    outlooks += grow(unit, range(30, 50))
    return Life(outlooks, kept, fan, unit.forecaster(outlooks[29]))


def grow(unit: Unit, tests: range, settings: PrognosisSettings = TEN_HOURS) -> list[Outlook]:
    """Return the outlooks after tests of a unit whose friction grows by 0.01 per test."""
    outlooks = []
    for number in tests:
        estimate = made_test(number, seed=1, friction=0.05 + 0.01 * number)
        outlooks.append(unit.update(estimate, None, settings))
    return outlooks


def test_fan_begins_at_the_tracked_value_and_passes_the_limit_near_the_median_life(life):
    outlook, fan = life.outlooks[29], life.fan
    [now] = [item.value for item in outlook.health.faults if item.name == "friction"]
    _, median, _ = fan.values["friction"]
    assert median[0] == pytest.approx(now, abs=0.005)
    passes = np.interp(life.forecaster.limits.of("friction"), median, fan.hours)
    # The median of the passages and the passage of the median differ by a few per cent at most.
    assert passes == pytest.approx(outlook.rul.hours_50, rel=0.1)
    assert fan.hours[-1] > outlook.rul.hours_50


def test_forecaster_does_not_change_with_later_tests(life):
    after = life.forecaster.fan()
    for name, values in life.fan.values.items():
        np.testing.assert_array_equal(values, after.values[name])
    # A forecaster requested too late belongs to another test.
    assert life.asked_late is None


def test_without_service_hours_there_is_neither_fan_nor_advice():
    unit = Unit(History("flap", "0001"))
    [outlook] = grow(unit, range(1), PrognosisSettings())
    forecaster = unit.forecaster(outlook)
    assert forecaster is not None
    assert forecaster.fan() is None
    assert advise(outlook, COSTS).action == "unknown"


def test_axis_extends_past_the_likely_end_of_life_but_not_far_past_the_observations():
    life = RemainingLife(True, 80.0, 100.0, 130.0, "")
    assert hours_ahead(life, 500.0) == pytest.approx(143.0)
    assert hours_ahead(life, 50.0) == pytest.approx(100.0)
    assert hours_ahead(RemainingLife(True, 80.0, 100.0, math.inf, ""), 500.0) == 250.0
    assert hours_ahead(RemainingLife.unknown("", ""), 500.0) == pytest.approx(30.0)


def test_distribution_of_the_earlier_of_two_lives():
    first = RemainingLife(True, 10.0, 50.0, 90.0, "one")
    second = RemainingLife(True, 20.0, 40.0, 95.0, "other")
    unknown = RemainingLife.unknown("none", "no growth")
    # For independent lives, the first to end does so sooner than either.
    both = RemainingLife(True, 5.0, 30.0, 92.0, "any")
    assert earlier(first, second, both) == RemainingLife(True, 5.0, 30.0, 90.0, "other")
    assert earlier(first, second, unknown) == RemainingLife(True, 10.0, 40.0, 90.0, "other")
    assert earlier(first, unknown, unknown) == earlier(unknown, first, unknown) == first
    too_far = RemainingLife.unknown("x", "too far")
    assert earlier(unknown, too_far, unknown).reason == "no growth; too far"


@pytest.mark.parametrize(("risk", "hours"), [(0.01, 10.0), (0.05, 50.0), (0.2, 200.0)])
def test_share_of_units_that_fail_before_removal_is_the_accepted_one(risk: float, hours: float):
    removal = removal_of(LIFETIME, LIVES, risk, hours_per_cycle=2.0, hours_a_day=8.0)
    assert removal.hours == hours
    assert np.mean(removal.hours > LIVES) < risk <= np.mean(removal.hours >= LIVES)
    assert (removal.cycles, removal.days) == (hours / 2.0, hours / 8.0)


@pytest.mark.parametrize(
    ("hours_05", "risk", "hours"),
    # The quantiles may come from other samples, but a lower risk is never later than the 5 %
    # quantile.
    [(8.0, 0.01, 8.0), (8.0, 0.05, 8.0), (300.0, 0.2, 300.0)],
)
def test_removal_does_not_contradict_published_quantiles(
    hours_05: float, risk: float, hours: float
):
    life = RemainingLife(True, hours_05, 500.0, 950.0, "")
    assert removal_of(life, LIVES, risk, math.nan, math.nan).hours == hours


def test_removal_with_an_unknown_part_stays_unknown():
    unknown = removal_of(RemainingLife.unknown("", "why"), np.empty(0), 0.05, 2.0, 8.0)
    assert all(map(math.isnan, (unknown.hours, unknown.cycles, unknown.days)))
    removal = removal_of(LIFETIME, LIVES, 0.05, math.nan, math.nan)
    assert removal.hours == 50.0
    assert all(map(math.isnan, (removal.cycles, removal.days)))


N = 2000
QUANTILES = (np.arange(N) + 0.5) / N
COSTS = Costs(removal=1.0, failure=5.0, unit="kEUR")


def weibull(shape: float, scale: float) -> np.ndarray:
    return scale * (-np.log1p(-QUANTILES)) ** (1.0 / shape)


def decision(lives: np.ndarray, hours: float = 0.0, interval: float = 10.0, **costs: float):
    return Decision(replace(COSTS, **costs), hours, interval, lives)


def test_age_replacement_of_a_weibull_life_agrees_with_renewal_theory():
    # Barlow and Proschan: h(T) int_0^T R - F(T) = c_p / (c_f - c_p); shape 2, scale 100, costs 1
    # and 5. Its root was computed by bisection on a fine grid.
    t = np.linspace(0.0, 300.0, 300_001)
    survival = np.exp(-((t / 100.0) ** 2))
    area = np.concatenate([[0.0], np.cumsum(0.5 * (survival[1:] + survival[:-1]) * np.diff(t))])
    excess = 2.0 * t / 100.0**2 * area - (1.0 - survival) - 1.0 / 4.0
    best = t[np.searchsorted(excess, 0.0)]
    rate = (1.0 + 4.0 * (1.0 - np.exp(-((best / 100.0) ** 2)))) / np.interp(best, t, area)
    removal = decision(weibull(2.0, 100.0), interval=1e4).remove()
    # The optimum is flat: its cost rate is exact, its position less so.
    assert removal.rate == pytest.approx(rate, rel=2e-3)
    assert removal.removal_hours == pytest.approx(best, rel=0.1)


def test_memoryless_life_is_never_cut_short():
    """A removal before the failure saves nothing if the new unit is no better."""
    lives = weibull(1.0, 100.0)
    removal = decision(lives, interval=1e5).remove()
    assert removal.removal_hours == pytest.approx(lives[-1])


def test_removal_before_a_certain_end_waits_while_a_test_comes_before_it():
    near, far = np.full(N, 15.0), np.full(N, 25.0)
    assert decision(near, 500.0).remove().rate < decision(near, 500.0, 20.0).wait().rate
    assert decision(far, 500.0).wait().rate < decision(far, 500.0).remove().rate
    # With a lead time of 20 h, the test in 10 h is too late.
    late = decision(far, 500.0, lead_time=20.0)
    assert late.remove().rate < late.wait().rate
    assert late.remove().removal_hours == pytest.approx(25.0)


def test_missing_tests_increase_the_cost_of_waiting():
    lives = np.linspace(12.0, 60.0, N)
    sure = decision(lives, 500.0)
    assert replace(sure, missing_share=0.3).wait().rate > 1.2 * sure.wait().rate
    assert replace(sure, missing_share=1e-9).wait().rate == pytest.approx(sure.wait().rate)


def test_waiting_is_worth_less_if_the_tests_are_uninformative():
    lives = np.concatenate(
        [np.linspace(10.5, 80.0, N // 10), np.linspace(300.0, 900.0, N - N // 10)]
    )
    tells = decision(lives, 200.0)
    assert tells.wait().rate < replace(tells, tests_tell=False).wait().rate


def two_levels() -> tuple[Decision, np.ndarray]:
    """Return a unit that is either nearly failed or nearly new, which its tests do not show."""
    is_worn = np.arange(N) % 4 == 0
    rng = np.random.default_rng(1)
    lives = np.where(is_worn, rng.uniform(2.0, 9.0, N), rng.uniform(400.0, 500.0, N))
    levels = np.where(is_worn, 0.48, 0.1) + 0.001 * rng.standard_normal(N)
    made = Decision(replace(COSTS, inspection=0.05), 500.0, 10.0, lives, 0.0, tests_tell=False)
    return made, levels


def test_inspection_pays_if_its_result_decides_the_removal():
    made, levels = two_levels()
    least = min(made.remove().rate, made.wait().rate)
    inspected = made.inspect(levels)
    # A quarter is removed after 500 h, the others about 400 h later.
    assert inspected.rate == pytest.approx((1.0 + 0.05) / (500.0 + 0.75 * 400.0), rel=0.05)
    assert inspected.rate < 0.8 * least
    dear = replace(made, costs=replace(made.costs, inspection=1.0))
    assert dear.inspect(levels).rate > least


def test_uninformative_inspection_adds_only_its_cost():
    made, levels = two_levels()
    reported = np.random.default_rng(2).permutation(levels)
    assert made.inspect(reported).rate > min(made.remove().rate, made.wait().rate)


@pytest.mark.parametrize(
    ("costs", "words"),
    [
        (Costs(), "no costs are given"),
        (Costs(removal=5.0, failure=5.0), "costs.failure = 5: expected more than costs.removal"),
    ],
)
def test_without_usable_costs_there_is_no_advice(life, costs: Costs, words: str):
    advice = advise(life.outlooks[19], costs)
    assert advice.action == "unknown"
    assert words in advice.reason
    assert math.isnan(advice.flight_hours)


def test_advice_changes_from_continue_to_remove_before_the_limit(life):
    early = advise(life.outlooks[2], COSTS)
    assert (early.action, math.isnan(early.expected_cost)) == ("continue", True)
    assert "the remaining life is unknown" in early.reason
    actions = {}
    for tests in (26, 34, 40, 44):
        outlook = life.outlooks[tests - 1]
        actions[tests] = advice = advise(outlook, COSTS)
        assert advice.flight_hours == pytest.approx(outlook.flight_hours + advice.from_now)
        assert advice.expected_cost <= advice.cost_of_immediate_removal
    assert [action.action for action in actions.values()][:2] == ["continue", "continue"]
    assert actions[44].action == "remove"
    assert actions[44].flight_hours < 460.0
    assert "kEUR/h" in actions[44].reason


def test_failed_unit_is_advised_to_be_removed_at_once(life):
    advice = advise(life.outlooks[-1], COSTS)
    assert (advice.action, advice.from_now, advice.probability_of_failure) == ("remove", 0.0, 1.0)
    assert advice.reason.startswith("Remove now: failed since")


MARGIN = FaultHealth("torque_margin", WARN, 0.59, 0.01, 0.5, 0.62, True, 0.4)
PLAY = FaultHealth("free_play", ERROR, 6e-4, 1e-5, 5e-4, 1e-4, False, 1.2)
FRICTION = FaultHealth("friction", WARN, 0.2, 0.01, 0.5, 0.1, False, 0.4)


def outlook(level: int, *items: FaultHealth, reason: str = "", **changes: object) -> Outlook:
    health = Health(
        level,
        0.5,
        1,
        1.0,
        "",
        faults=tuple(item for item in items if item.name == "friction"),
        requirements=tuple(item for item in items if item.name != "friction"),
        reason=reason,
    )
    return replace(unknown_outlook(""), health=health, **changes)


def test_cause_names_the_item_that_determines_the_level_with_value_and_limit():
    assert cause_of_level(outlook(OK)) == ""
    words = "torque margin 0.59 (warns below 0.62, fails below 0.5)"
    assert cause_of_level(outlook(WARN, MARGIN)) == words
    failed = outlook(ERROR, MARGIN, PLAY)
    assert cause_of_level(failed) == "free play 0.6 mrad (failed: above 0.5 mrad)"
    margin = replace(MARGIN, value=0.49996, level=ERROR)
    assert cause_of_level(outlook(ERROR, margin)) == "torque margin 0.49996 (failed: below 0.5)"
    stale = outlook(STALE, reason="no telemetry for 3 s")
    assert cause_of_level(stale) == "no telemetry for 3 s"
    two = outlook(WARN, FRICTION, MARGIN, dominant_fault="torque_margin")
    assert cause_of_level(two) == (
        "torque margin 0.59 (warns below 0.62, fails below 0.5), "
        "friction 0.2 (warns above 0.1, fails above 0.5)"
    )
    # If the latest test contradicts a failure, as after a repair, the text states the current
    # value.
    repaired = outlook(ERROR, PLAY, replace(FRICTION, held=0.0))
    assert cause_of_level(repaired) == (
        "free play 0.6 mrad (failed: above 0.5 mrad), friction 0 in the latest test, to be "
        "confirmed by the next test, 0.2 before (warns above 0.1, fails above 0.5)"
    )


def test_failed_unit_is_advised_to_be_removed_even_if_its_health_is_stale():
    lives = {"free_play": RemainingLife.unknown("free play exceeds 0.5 mrad", "")}
    failed = outlook(ERROR, PLAY, lives=lives, flight_hours=170.0, failed_since=150.0)
    words = "Remove now: failed since 150 h (now 170 h): free play exceeds 0.5 mrad"
    assert removal_text(failed) == words
    stale = replace(failed, health=replace(failed.health, level=STALE))
    assert removal_text(stale) == words
    unknown_since = replace(failed, failed_since=math.nan)
    assert removal_text(unknown_since) == "Remove now: failed: free play exceeds 0.5 mrad"


def test_life_that_ends_beyond_the_horizon_has_no_median_hour():
    life = RemainingLife(True, 20.0, math.inf, math.inf, "friction exceeds 0.5")
    removal = Removal(hours=20.0)
    words = removal_text(outlook(OK, rul=life, flight_hours=100.0, removal=removal))
    assert words.startswith("Remove before 120 service hours (in 20 h; 5 % risk")
    assert "median end of life beyond the horizon" in words


def test_removal_is_reported_in_hours_cycles_and_days_at_the_accepted_risk():
    life = RemainingLife(True, 20.0, 50.0, 90.0, "friction exceeds 0.5")
    removal = Removal(0.125, 30.0, 15.0, 3.75, 8.0)
    words = removal_text(outlook(OK, rul=life, flight_hours=100.0, removal=removal))
    assert words == (
        "Remove before 130 service hours (in 30 h, 15 test cycles, 4 days at 8 h a day; "
        "12.5 % risk of failure until then); median end of life 150 h: friction exceeds 0.5"
    )
    soon = removal._replace(hours=0.4, cycles=0.2, days=math.nan)
    words = removal_text(outlook(OK, rul=life, flight_hours=100.0, removal=soon))
    assert words.startswith("Remove now (in 0 h, 0 test cycles; 12.5 % risk")
