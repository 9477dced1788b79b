# SPDX-License-Identifier: Apache-2.0
"""Remaining useful life: first passage, duty, horizon, future faults, and tests to wait for."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import COMPONENTS, FAULT_NAMES, HIGHEST
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.duty.course import FutureDuty
from ema_monitor.prognosis.growth.forecast import draw, futures, lives
from ema_monitor.prognosis.growth.mixture import Mixture
from ema_monitor.prognosis.growth.prediction import beyond_horizon, growth_not_certain
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth.tracker_settings import NOMINAL_LAWS, KnownLaw, TrackerSettings
from ema_sim.growth import Growth, grow

from .tracked_lives import feed, observed, of

LIMITS = HealthLimits()


BACKLASH = COMPONENTS.index("backlash")


def sure_of(law: str, rate: float, shape: float, x: float) -> tuple[Mixture, float]:
    """Return a mixture certain of law, rate and level of a backlash, and its rate on the grid."""
    given_law = KnownLaw(law, rate, 0.05, shape, diffusion=1e-3)
    mixture = Mixture(LIMITS, TrackerSettings(laws={**NOMINAL_LAWS, "backlash": given_law}))
    cells, of_it = mixture.bank.cells, mixture.members[BACKLASH]
    of_it = of_it[: np.sum(cells.component == BACKLASH)]
    nearest = of_it[np.argmin(np.abs(np.log(np.maximum(cells.rate[of_it], 1e-12) / rate)))]
    mixture.weight[mixture.members[BACKLASH]] = 0.0
    mixture.weight[nearest] = 1.0
    mixture.bank.mean[:] = cells.side * x
    mixture.bank.variance[:] = 0.0
    return mixture, float(cells.rate[nearest])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "rate", "shape", "x"),
    [
        ("archard", 3e-4, 3.0, 0.25),
        ("exponential", 2e-3, 0.05, 0.2),
        ("self_heating", 3e-4, 3.0, 0.2),
        ("power", 2000.0, 1.6, 0.2),
        ("linear", 5e-4, 0.0, 0.3),
        ("drift", 3e-4, 0.0, 0.3),
    ],
)
def test_first_passage_agrees_with_simulated_growth(law, rate, shape, x):
    mixture, cell_rate = sure_of(law, rate, shape, x)
    rng = np.random.default_rng(0)
    # The rates equal the rate of the cell, so that only the noise is compared.
    predicted = lives(draw(mixture, 4000, np.zeros(7), rng), rng)[BACKLASH]
    growth = Growth(law, cell_rate, shape, 1e-3 if law == "drift" else 0.3)
    passed = [hours_to_half(growth, x, rng) for _ in range(150)]
    # Four standard errors of the median of 150, 1.25 / sqrt(150) each, and half an interval.
    spread = float(np.std(passed))
    assert np.median(predicted) == pytest.approx(np.median(passed), abs=0.41 * spread + 5.0)
    assert np.std(predicted) == pytest.approx(spread, rel=0.3)


def hours_to_half(growth: Growth, x: float, rng: np.random.Generator) -> float:
    """Return the hours in which a backlash grows to 0.5 with tests every 10 h."""
    before, after, hours = x, x, 0.0
    while after < 0.5:
        before = after
        after = float(grow({"backlash": before}, {"backlash": growth}, hours, 10.0, rng)[1])
        hours += 10.0
    return hours - 10.0 * (after - 0.5) / (after - before)


def test_growth_of_unknown_law_may_change_permanently():
    rng, fixed_laws = np.random.default_rng(1), TrackerSettings(laws=NOMINAL_LAWS)
    for settings, hours in ((fixed_laws, 300.0), (TrackerSettings(), 0.0)):
        assert np.all(draw(Mixture(LIMITS, settings), 100, np.full(7, hours), rng).changed == 1.0)
    sample = draw(Mixture(LIMITS, TrackerSettings()), 20_000, np.full(7, 300.0), rng)
    assert np.median(sample.change) == pytest.approx(300.0, rel=0.02)
    assert np.quantile(sample.changed[BACKLASH], [0.1, 0.9]) == pytest.approx([0.55, 10], rel=0.3)
    ones, limit = np.ones_like(sample.changed), LIMITS.of("backlash")
    steady, sooner = (replace(sample, change=200.0 * ones, changed=of * ones) for of in (1.0, 4.0))
    slow, fast = (np.mean(lives(drawn, rng)[BACKLASH] < 3000.0) for drawn in (steady, sooner))
    over = futures(sooner, np.linspace(0.0, 3000.0, 20)[:, None, None], rng)[:, BACKLASH]
    assert slow + 0.03 < fast == pytest.approx(np.mean(over.max(axis=0) > limit), abs=0.015)


@pytest.fixture(scope="module")
def tracker() -> Tracker:
    tracker = Tracker()
    growth = {
        "friction": Growth("exponential", 2.5e-3, 0.05, 0.3),
        "backlash": Growth("linear", 2e-4, noise=0.3),
    }
    feed(tracker, growth, 600.0, np.random.default_rng(2))
    return tracker


def test_lives_are_inversely_proportional_to_the_duty(tracker):
    single, double = tracker.predict(), tracker.predict(FutureDuty(2.0))
    np.testing.assert_allclose(double.samples, single.samples / 2.0)
    assert double.overall.hours_50 == pytest.approx(single.overall.hours_50 / 2.0)
    assert double.future.factor == 2.0
    assert str(single.future) == "future use as in the past"
    assert "2 times" in str(double.future)
    np.testing.assert_allclose(
        tracker.futures([100.0], duty=FutureDuty(2.0)), tracker.futures([200.0]), atol=1e-12
    )


def test_overall_life_is_the_earliest_of_the_components(tracker):
    prognosis = tracker.predict()
    assert prognosis.dominant_fault == "friction"
    lives = [life for life in prognosis.components.values() if life.known]
    assert len(lives) == 2
    for quantile in ("hours_05", "hours_50", "hours_95"):
        overall = getattr(prognosis.overall, quantile)
        assert overall <= min(getattr(life, quantile) for life in lives)
    assert prognosis.overall.hours_05 < prognosis.overall.hours_50 < prognosis.overall.hours_95
    assert prognosis.overall.criterion == "friction exceeds 0.5"
    assert prognosis.components["gain"].reason == "no significant growth"


def test_overall_life_includes_a_fault_whose_growth_is_not_certain_so_far():
    """A fast short circuit has just begun next to slow wear; the life by wear is too long."""
    tracker = Tracker()
    growth = {
        "backlash": Growth("linear", 4e-4, noise=0.3),
        "short_circuit_c": Growth("self_heating", 3.5e-4, 6.0, noise=0.3, onset=430.0),
    }
    feed(tracker, growth, 500.0, np.random.default_rng(2))
    prognosis = tracker.predict()
    assert not prognosis.components["short_circuit_c"].known
    assert "growth is not certain yet" in prognosis.components["short_circuit_c"].reason
    assert prognosis.overall.hours_50 < 0.6 * prognosis.components["backlash"].hours_50
    assert prognosis.dominant_fault == "short_circuit_c"
    assert prognosis.overall.criterion == "short circuit C exceeds 0.25"


def test_nothing_is_reported_before_the_first_test():
    prognosis = Tracker().predict()
    assert not prognosis.overall.known
    assert prognosis.overall.reason == "fewer than two tests agree so far"
    assert np.isnan(prognosis.hours)


def test_fault_beyond_its_limit_has_no_life_left():
    tracker = Tracker()
    for i in range(6):
        tracker.update(observed(10.0 * i, {"short_circuit_c": 0.4}))
    prognosis = tracker.predict()
    assert prognosis.dominant_fault == "short_circuit_c"
    assert (prognosis.overall.hours_05, prognosis.overall.hours_95) == (0.0, 0.0)


def test_life_beyond_the_horizon_is_not_reported():
    settings = TrackerSettings(horizon_hours=300.0)
    growth = {"backlash": Growth("linear", 3e-4)}
    short, default = Tracker(settings=settings), Tracker()
    for tracker in (short, default):
        feed(tracker, growth, 500.0, np.random.default_rng(3))
    assert default.predict().overall.hours_50 > 300.0
    assert "horizon of 300 h" in short.predict().overall.reason


def test_fan_starts_at_the_current_value_and_widens(tracker):
    fan = tracker.fan([0.0, 20.0, 50.0, 90.0])
    friction = fan.values["friction"]
    assert friction.shape == (3, 4)
    assert set(fan.values) == set(COMPONENTS)
    assert friction[1, 0] == pytest.approx(of(tracker, "friction").value, abs=1e-3)
    assert np.all(np.diff(friction, axis=0) >= 0.0)
    assert np.all(np.diff(friction, axis=1) >= 0.0)
    assert np.all(np.diff(friction[-1] - friction[0]) > 0.0)


def test_futures_are_fault_vectors_within_their_range(tracker):
    vectors = tracker.futures([0.0, 1e5], n=50)
    assert vectors.shape == (2, 50, 8)
    assert np.all((vectors >= 0.0) & (vectors <= HIGHEST))
    # Growth that slows down may stop before the limit.
    assert np.mean(vectors[1, :, 0] == 1.0) > 0.8
    assert np.all(vectors[..., FAULT_NAMES.index("eccentricity_phase")] == 0.5)


@pytest.mark.parametrize("hours", [[-1.0], [2.0, 1.0], [np.nan]])
def test_impossible_future_hours_are_refused(tracker, hours):
    with pytest.raises(ValueError, match="ascending numbers of at least 0"):
        tracker.futures(hours)


def test_tests_until_growth_is_certain_are_predicted_from_the_evidence_per_test():
    # From 0.5 to 0.05 in ten tests is a factor of 10; 1e-4 is 500 times lower: 27 tests.
    words = growth_not_certain(0.05, 10)
    assert words == "growth is not certain yet: its probability is 0.950 (about 27 more tests)"
    assert growth_not_certain(1e-5, 3).endswith("(about 2 more tests)")
    assert growth_not_certain(0.49, 100).endswith("0.510")
    assert growth_not_certain(0.6, 10) == "no significant growth"


@pytest.mark.parametrize(
    ("median", "words"),
    [
        (900.0, ""),
        (2000.0, "limit not within the horizon of 1000 h (about 10 more tests)"),
        (1e5, "limit not within the horizon of 1000 h"),
    ],
)
def test_tests_until_a_life_is_within_the_horizon_are_reported(median: float, words: str):
    # 11 tests in 100 h, looking ten times as far ahead: after 91 h more, 1,909 h are left and
    # within the horizon.
    assert beyond_horizon(median, 100.0, 11, TrackerSettings(horizon_factor=10.0)) == words


def test_expected_number_of_waiting_tests_is_about_right():
    tracker = Tracker(settings=TrackerSettings(horizon_factor=1.0))
    reported: dict[int, int] = {}
    number, rng = 0, np.random.default_rng(1)
    for number in range(1, 90):
        tracker.update(observed(10.0 * number, {"friction": 0.05 + 5e-3 * number}, rng))
        reason = tracker.predict().components["friction"].reason
        if not reason:
            break
        if "horizon" in reason:
            reported[number] = int(reason.split("about ")[1].split()[0])
    assert reported, "never beyond the horizon"
    first = min(reported)
    assert number - first <= 2 * reported[first] + 2
