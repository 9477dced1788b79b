"""The first time at which faults to come fail a required performance."""

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, HIGHEST, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.prognosis.requirements.required_life import failure_hours
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
    found = failure_hours(requirements, future, HOURS)
    for name in failing:
        expected = by_brute_force(requirements, future, name)
        both = np.isfinite(expected) & np.isfinite(found[name])
        assert both.sum() > 40
        missed = found[name][both] - expected[both]
        # Twice what was seen over twelve such sets of samples.
        assert np.sqrt(np.mean(missed**2)) < 0.04 * np.median(expected[both])
        estimated, right = (
            np.quantile(np.minimum(lives, HOURS[-1]), [0.05, 0.5, 0.95], method="inverted_cdf")
            for lives in (found[name], expected)
        )
        np.testing.assert_allclose(estimated, right, rtol=0.035)


@pytest.mark.slow
def test_low_gain_ends_life_by_tracking_and_bandwidth_where_these_are_strict(strict):
    future = growing("gain", 0.5, seed=8)
    found = failure_hours(strict, future, HOURS)
    for name in ("tracking_error", "bandwidth"):
        expected = by_brute_force(strict, future, name)
        np.testing.assert_allclose(found[name], expected, rtol=0.01)


def test_free_play_fails_at_the_closed_form_hour(requirements):
    limit = (5e-4 / (ACTUATOR.BLK * ACTUATOR.tau) - 1.0) / 99.0
    future = np.tile(healthy_faults(), (1, len(HOURS), 1))
    future[0, :, 1] = HOURS / 1000.0
    [hours] = failure_hours(requirements, future, HOURS)["free_play"]
    assert hours == pytest.approx(1000.0 * limit, rel=1e-9)


def test_constant_healthy_faults_fail_nothing(requirements):
    future = np.tile(healthy_faults(), (20, len(HOURS), 1))
    found = failure_hours(requirements, future, HOURS)
    assert all(np.isinf(found[name]).all() for name in REQUIREMENTS)


def test_what_fails_already_fails_at_once(requirements):
    future = np.tile(healthy_faults(), (20, len(HOURS), 1))
    future[:, :, 1] = 0.8
    found = failure_hours(requirements, future, HOURS)
    assert not found["free_play"].any()
    assert not found["torque_margin"].any()
