"""Abrupt changes of the rate of growth: told once, where they are, and not where there are none."""

from collections.abc import Callable

import numpy as np
import pytest

from ema_core.faults import COMPONENTS, FAULT_NAMES, healthy_faults
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.regimes import GrowthNoise, RegimeChange, RegimeWatch
from ema_monitor.prognosis.growth.tracker import Tracker

from .tracked_lives import SIGMA, observed, of

NOISE = GrowthNoise(correlation=0.3, large=0.01, hours=0.94, diffusion=0.0)
FRICTION = COMPONENTS.index("friction")


ALL = np.ones(len(COMPONENTS), dtype=bool)
VARIANCE = np.full(len(COMPONENTS), SIGMA**2)


def measured(hours: float, friction: float) -> Measurement:
    faults = healthy_faults()
    faults[FAULT_NAMES.index("friction")] = friction
    return Measurement(hours, faults, SIGMA**2 * np.eye(8), np.zeros(8, dtype=bool))


def changes(
    level: Callable[[float], float], seed: int, tests: int = 110, noise: GrowthNoise = NOISE
) -> list[tuple[int, RegimeChange]]:
    """Return the changes found in a fault, with the tests that showed them."""
    watch, rng = RegimeWatch(), np.random.default_rng(seed)
    found, error = [], SIGMA * rng.standard_normal()
    fresh = np.sqrt(1.0 - noise.correlation**2)
    for test in range(tests):
        watch.add(measured(10.0 * test, level(10.0 * test) + error), VARIANCE, ALL)
        if (change := watch.judge(FRICTION, noise)) is not None:
            found.append((test, change))
        error = noise.correlation * error + fresh * SIGMA * rng.standard_normal()
    return found


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("factor", [3.0, 0.3])
def test_rate_that_changes_is_told_once_and_where(seed, factor):
    rate = 3e-4
    found = changes(lambda u: rate * (min(u, 500.0) + factor * max(u - 500.0, 0.0)), seed)
    [(test, change)] = found
    assert 53 <= test <= 80
    assert change.hours == pytest.approx(500.0, abs=60.0)
    assert change.before == pytest.approx(rate, rel=0.15)
    assert change.after == pytest.approx(factor * rate, abs=4.0 * change.sigma)


@pytest.mark.parametrize(
    "level",
    [
        lambda u: 4e-4 * u,
        lambda u: 0.02 * np.exp(2.7e-3 * u),
        lambda u: -np.log(1.0 - u / 1180.0) / 6.0,
        lambda u: 2e-4 * u + 0.1 * (1.0 - np.exp(-u / 120.0)),
        lambda u: 2e-4 * u + 0.02 * np.sin(2.0 * np.pi * u / 420.0),
        lambda u: 0.5 / (1.0 + np.exp(-(u - 800.0) / 180.0)),
    ],
    ids=["line", "exponential", "self-heating", "settling", "wave", "logistic"],
)
@pytest.mark.parametrize("seed", range(4))
def test_growth_without_a_break_is_none(level, seed):
    assert changes(level, seed) == []


def test_growth_that_diffuses_is_not_taken_for_changes():
    diffusion, false = 1e-3, 0
    for seed in range(6):
        walk = np.cumsum(
            diffusion * np.sqrt(10.0) * np.random.default_rng(seed).standard_normal(200)
        )
        level = np.abs(walk + 2e-3 * np.arange(200))
        noise = GrowthNoise(0.0, 0.01, 0.94, diffusion)
        false += len(
            changes(lambda u, level=level: float(level[round(u / 10.0)]), seed, noise=noise)
        )
    # One in six lives by chance is as few as the margins promise.
    assert false <= 1


@pytest.mark.slow
def test_tracker_tells_a_change_and_follows_it():
    tracker, rng, told, value = Tracker(), np.random.default_rng(5), [], 0.0
    for test in range(80):
        value += 10.0 * (2e-4 if test < 50 else 8e-4)
        told += tracker.update(observed(10.0 * test, {"friction": value}, rng))
        if told and told[-1].kind == "regime":
            break
    [event] = told
    assert event.component == "friction"
    assert event.hours == pytest.approx(500.0, abs=50.0)
    assert event.kind == "regime"
    assert "times as fast since about" in event.text
    # At once, for what was known of the rate is forgotten; to the error of some ten tests.
    assert of(tracker, "friction").trend == pytest.approx(8e-4, rel=0.25)
    # The probability that it grows is not.
    assert tracker.predict().overall.known


def test_tests_of_one_hour_show_no_change():
    """As by seven tests on the ground, one after the other."""
    watch = RegimeWatch()
    for hours in (*np.arange(0.0, 165.0, 5.0), *[165.0] * 7):
        watch.add(measured(hours, 1e-3 * hours), VARIANCE, ALL)
        assert watch.judge(FRICTION, NOISE) is None
