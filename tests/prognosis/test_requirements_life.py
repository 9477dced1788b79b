"""The first time at which faults to come spoil a required performance."""

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, HIGHEST, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.prognosis.requirements.required_life import life_by_requirements
from ema_monitor.prognosis.requirements.requirements import (
    REQUIREMENTS,
    RequirementLimits,
    Requirements,
)

ACTUATOR = ActuatorParameters()
HOURS = np.linspace(0.0, 1000.0, 61)


@pytest.fixture(scope="module")
def requirements():
    return Requirements(ACTUATOR)


@pytest.fixture(scope="module")
def strict():
    limits = RequirementLimits(tracking_error=0.5e-3, bandwidth=25.0)
    return Requirements(ACTUATOR, limits)


def growing(name, end, seed, n=100):
    """Samples of one fault that grows to about `end`, bent and spread, the others a little."""
    rng = np.random.default_rng(seed)
    start = 0.05 * rng.random(8) + 0.005 * rng.standard_normal((n, 8))
    to = np.full(8, 0.05)
    to[FAULT_NAMES.index(name)] = end
    rate = np.exp(0.25 * rng.standard_normal((n, 1, 8)))
    bent = 1.0 + rng.random((n, 1, 8))
    grown = start[:, None] + to * rate * (HOURS[:, None] / HOURS[-1]) ** bent
    grown[..., 6] = 0.3
    grown[..., 7] = 0.5 - grown[..., 7]
    return np.clip(grown, 0.0, HIGHEST)


def by_brute_force(requirements, future, name):
    reserves = requirements.exact_reserves((name,), future.reshape(-1, 8)).reshape(future.shape[:2])
    lives = np.full(len(future), np.inf)
    for row, left in enumerate(reserves):
        failed = np.flatnonzero(left < 0.0)
        if failed.size:
            k = failed[0]
            lives[row] = HOURS[k]
            if k:
                share = left[k - 1] / (left[k - 1] - left[k])
                lives[row] = HOURS[k - 1] + share * (HOURS[k] - HOURS[k - 1])
    return lives


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "end", "failing"),
    [
        ("backlash", 0.8, ("free_play", "torque_margin")),
        ("friction", 0.9, ("torque_margin",)),
        ("short_circuit_a", 0.9, ("torque_margin",)),
        ("eccentricity", 0.9, ("torque_margin",)),
    ],
)
def test_first_failure_is_that_of_the_model_at_every_hour(requirements, fault, end, failing):
    future = growing(fault, end, seed=3)
    found = life_by_requirements(requirements, future, HOURS)
    for name in failing:
        expected = by_brute_force(requirements, future, name)
        both = np.isfinite(expected) & np.isfinite(found.samples[name])
        assert both.sum() > 40
        missed = found.samples[name][both] - expected[both]
        # Twice what was seen over twelve such sets of samples.
        assert np.sqrt(np.mean(missed**2)) < 0.04 * np.median(expected[both])
        told, right = (
            np.quantile(np.minimum(lives, HOURS[-1]), [0.05, 0.5, 0.95], method="inverted_cdf")
            for lives in (found.samples[name], expected)
        )
        np.testing.assert_allclose(told, right, rtol=0.035)


@pytest.mark.slow
def test_low_gain_ends_life_by_tracking_and_bandwidth_where_these_are_strict(strict):
    future = growing("gain", 0.5, seed=8)
    found = life_by_requirements(strict, future, HOURS)
    for name in ("tracking_error", "bandwidth"):
        expected = by_brute_force(strict, future, name)
        np.testing.assert_allclose(found.samples[name], expected, rtol=0.01)


def test_free_play_fails_at_the_closed_form_hour(requirements):
    limit = (5e-4 / (ACTUATOR.BLK * ACTUATOR.tau) - 1.0) / 99.0
    future = np.tile(healthy_faults(), (1, len(HOURS), 1))
    future[0, :, 1] = HOURS / 1000.0
    life = life_by_requirements(requirements, future, HOURS).lives["free_play"]
    assert life.known
    assert life.hours_50 == pytest.approx(1000.0 * limit, rel=1e-9)
    assert life.criterion == "free play exceeds 0.0005 rad"


def test_overall_is_the_earliest_in_each_sample(requirements):
    found = life_by_requirements(requirements, growing("backlash", 0.8, seed=1), HOURS)
    earliest = np.min([found.samples[name] for name in REQUIREMENTS], axis=0)
    np.testing.assert_array_equal(found.overall_samples, earliest)
    assert found.dominant == "torque_margin"
    assert found.overall.hours_05 <= found.overall.hours_50 <= found.overall.hours_95


def test_life_of_constant_healthy_faults_is_not_known(requirements):
    future = np.tile(healthy_faults(), (20, len(HOURS), 1))
    found = life_by_requirements(requirements, future, HOURS)
    for life in (*found.lives.values(), found.overall):
        assert not life.known
        assert np.isnan(life.hours_50)
        assert life.reason == "not within the 1000 h looked ahead"
    assert found.dominant == ""


def test_life_is_over_when_a_requirement_fails_already(requirements):
    future = np.tile(healthy_faults(), (20, len(HOURS), 1))
    future[:, :, 1] = 0.8
    found = life_by_requirements(requirements, future, HOURS)
    assert found.lives["free_play"].hours_95 == 0.0
    assert found.lives["torque_margin"].hours_95 == 0.0


def test_samples_with_nan_are_left_out(requirements):
    future = growing("backlash", 0.8, seed=1)
    whole = life_by_requirements(requirements, future[:50], HOURS)
    future[50:, 30, 0] = np.nan
    found = life_by_requirements(requirements, future, HOURS)
    assert np.isnan(found.overall_samples[50:]).all()
    np.testing.assert_array_equal(found.overall_samples[:50], whole.overall_samples)
    assert found.overall == whole.overall


def test_life_is_not_known_when_every_sample_has_nan(requirements):
    found = life_by_requirements(requirements, np.full((5, len(HOURS), 8), np.nan), HOURS)
    for life in (*found.lives.values(), found.overall):
        assert not life.known
        assert life.reason == "the faults to come are unknown"


def test_growth_without_bound_stays_at_the_end_of_the_range(requirements):
    future = growing("backlash", 0.8, seed=1)
    bounded = life_by_requirements(requirements, future, HOURS)
    future[:, -1, 1] = np.inf
    found = life_by_requirements(requirements, future, HOURS)
    assert found.lives["torque_margin"].hours_50 == pytest.approx(
        bounded.lives["torque_margin"].hours_50, rel=0.02
    )


@pytest.mark.parametrize(
    ("future", "hours", "message"),
    [
        (np.zeros((3, 5, 7)), np.arange(5.0), r"expected \(samples, times, 8\)"),
        (np.zeros((3, 5, 8)), np.arange(4.0), r"expected \(5,\)"),
        (np.zeros((3, 2, 8)), np.array([1.0, 1.0]), "do not rise"),
    ],
)
def test_shapes_and_hours_that_do_not_agree_are_refused(requirements, future, hours, message):
    with pytest.raises(ValueError, match=message):
        life_by_requirements(requirements, future, hours)
