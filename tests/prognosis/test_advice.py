"""Advice is the cheapest of removal, waiting and inspection, in closed form where there is one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ema_monitor.prognosis.advice import Costs, Decision, advise
from ema_monitor.prognosis.settings import PrognosisSettings

from .test_forecaster import SETTINGS, grown

N = 2000
QUANTILES = (np.arange(N) + 0.5) / N
COSTS = Costs(removal=1.0, failure=5.0, unit="kEUR")


def weibull(shape: float, scale: float) -> np.ndarray:
    return scale * (-np.log1p(-QUANTILES)) ** (1.0 / shape)


def decision(lives: np.ndarray, hours: float = 0.0, interval: float = 10.0, **costs: float):
    return Decision(replace(COSTS, **costs), hours, interval, lives)


def test_age_replacement_of_a_weibull_life_is_that_of_renewal_theory():
    # Barlow and Proschan: h(T) int_0^T R - F(T) = c_p / (c_f - c_p); shape 2, scale 100, costs 1
    # and 5: its root, found by bisection on a fine grid.
    t = np.linspace(0.0, 300.0, 300_001)
    survival = np.exp(-((t / 100.0) ** 2))
    area = np.concatenate([[0.0], np.cumsum(0.5 * (survival[1:] + survival[:-1]) * np.diff(t))])
    excess = 2.0 * t / 100.0**2 * area - (1.0 - survival) - 1.0 / 4.0
    best = t[np.searchsorted(excess, 0.0)]
    rate = (1.0 + 4.0 * (1.0 - np.exp(-((best / 100.0) ** 2)))) / np.interp(best, t, area)
    found = decision(weibull(2.0, 100.0), interval=1e4).remove()
    # The optimum is flat: its rate is exact where its place is not.
    assert found.rate == pytest.approx(rate, rel=2e-3)
    assert found.removal_hours == pytest.approx(best, rel=0.1)


def test_life_without_memory_is_never_cut_short():
    """A removal before the failure saves nothing where the new unit is no better."""
    lives = weibull(1.0, 100.0)
    found = decision(lives, interval=1e5).remove()
    assert found.removal_hours == pytest.approx(lives[-1])


def test_certain_end_is_waited_for_as_long_as_a_test_comes_before_it():
    near, far = np.full(N, 15.0), np.full(N, 25.0)
    assert decision(near, 500.0).remove().rate < decision(near, 500.0, 20.0).wait().rate
    assert decision(far, 500.0).wait().rate < decision(far, 500.0).remove().rate
    # With a lead time of 20 h the test in 10 h comes too late.
    late = decision(far, 500.0, lead_time=20.0)
    assert late.remove().rate < late.wait().rate
    assert late.remove().removal_hours == pytest.approx(25.0)


def test_missing_tests_make_waiting_dearer():
    lives = np.linspace(12.0, 60.0, N)
    sure = decision(lives, 500.0)
    assert replace(sure, missing_share=0.3).wait().rate > 1.2 * sure.wait().rate
    assert replace(sure, missing_share=1e-9).wait().rate == pytest.approx(sure.wait().rate)


def test_waiting_is_worth_less_where_the_tests_do_not_tell():
    lives = np.concatenate(
        [np.linspace(10.5, 80.0, N // 10), np.linspace(300.0, 900.0, N - N // 10)]
    )
    tells = decision(lives, 200.0)
    assert tells.wait().rate < replace(tells, tests_tell=False).wait().rate


def two_levels() -> tuple[Decision, np.ndarray]:
    """A unit that is either nearly failed or nearly new, which its tests do not tell."""
    is_worn = np.arange(N) % 4 == 0
    rng = np.random.default_rng(1)
    lives = np.where(is_worn, rng.uniform(2.0, 9.0, N), rng.uniform(400.0, 500.0, N))
    levels = np.where(is_worn, 0.48, 0.1) + 0.001 * rng.standard_normal(N)
    made = Decision(replace(COSTS, inspection=0.05), 500.0, 10.0, lives, 0.0, tests_tell=False)
    return made, levels


def test_inspection_pays_where_it_tells_what_a_removal_hangs_on():
    made, levels = two_levels()
    least = min(made.remove().rate, made.wait().rate)
    inspected = made.inspect(levels)
    # A quarter is removed after 500 h, the others after 500 + about 400 h.
    assert inspected.rate == pytest.approx((1.0 + 0.05) / (500.0 + 0.75 * 400.0), rel=0.05)
    assert inspected.rate < 0.8 * least
    dear = replace(made, costs=replace(made.costs, inspection=1.0))
    assert dear.inspect(levels).rate > least


def test_inspection_that_tells_nothing_costs_what_it_costs():
    made, levels = two_levels()
    told = np.random.default_rng(2).permutation(levels)
    assert made.inspect(told).rate > min(made.remove().rate, made.wait().rate)


@pytest.mark.parametrize(
    ("costs", "words"),
    [
        (Costs(), "no costs are given"),
        (Costs(removal=5.0, failure=5.0), "costs.failure = 5: expected more than costs.removal"),
    ],
)
def test_without_usable_costs_there_is_no_advice(costs: Costs, words: str):
    _, outlook = grown(20)
    found = advise(outlook, costs)
    assert found.action == "unknown"
    assert words in found.reason
    assert math.isnan(found.hours)


def test_advice_over_a_life_goes_from_continue_to_remove_before_the_limit():
    # Friction of 0.05 + 0.01 a test reaches 0.5 at test 45, 460 h after the count began.
    _, outlook = grown(3)
    early = advise(outlook, COSTS)
    assert (early.action, math.isnan(early.rate)) == ("continue", True)
    assert "no remaining life is known" in early.reason
    actions = {}
    for tests in (26, 34, 40, 44):
        _, outlook = grown(tests)
        actions[tests] = found = advise(outlook, COSTS)
        assert found.hours == pytest.approx(outlook.hours + found.from_now)
        assert found.rate <= found.rate_at_once
    assert [one.action for one in actions.values()][:2] == ["continue", "continue"]
    assert actions[44].action == "remove"
    assert actions[44].hours < 460.0
    assert "kEUR/h" in actions[44].reason


def test_failed_unit_is_to_be_removed_now():
    _, outlook = grown(50)
    found = advise(outlook, COSTS)
    assert (found.action, found.from_now, found.probability) == ("remove", 0.0, 1.0)
    assert found.reason.startswith("Remove now: failed since")


def test_without_service_hours_there_is_no_advice():
    _, outlook = grown(10, PrognosisSettings())
    assert advise(outlook, COSTS).action == "unknown"
    assert SETTINGS.service.hours_per_cycle == 10.0
