"""Limits of required performance, and health as to it."""

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, fault_vector, healthy_faults
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.parameters import ActuatorParameters
from ema_monitor.prognosis.requirements.requirements import (
    MODELLED,
    REQUIREMENTS,
    RequirementLimits,
    Requirements,
)
from ema_monitor.prognosis.requirements.surrogate import Surrogate

ACTUATOR = ActuatorParameters()
PHASE = FAULT_NAMES.index("eccentricity_phase")


@pytest.fixture(scope="module")
def requirements():
    return Requirements(ACTUATOR)


def covariance(sigma=0.01):
    return sigma**2 * np.eye(8)


def without_phase(sigma):
    """The covariance where the direction of eccentricity is unobservable."""
    P = covariance(sigma)
    P[PHASE], P[:, PHASE] = np.nan, np.nan
    return P


def health_of(requirements, *args, **kwargs):
    return {item.name: item for item in requirements.judge(*args, **kwargs).healths}


def test_healthy_actuator_meets_every_default(requirements):
    reserves = requirements.exact_reserves(REQUIREMENTS, healthy_faults())
    np.testing.assert_allclose(reserves, 1.0, rtol=1e-12)
    for item in requirements.judge(healthy_faults(), covariance(1e-4)).healths:
        assert item.level == OK
        assert item.share == pytest.approx(0.0, abs=1e-12)


def test_healthy_figures_are_those_documented(requirements):
    healthy = requirements.healthy
    assert healthy["tracking_error"] == pytest.approx(2.14e-3, abs=5e-6)
    assert healthy["bandwidth"] == pytest.approx(32.9, abs=0.1)
    assert healthy["free_play"] == pytest.approx(1e-5)
    assert healthy["torque_margin"] == pytest.approx(0.653, abs=1e-3)


def test_limit_that_a_healthy_actuator_misses_is_refused_with_both_figures():
    with pytest.raises(ValueError, match=r"torque_margin: .* 0\.653 1 and misses .* 0\.9 1"):
        Requirements(ACTUATOR, RequirementLimits(torque_margin=0.9))


def test_limits_are_refused_by_name_value_unit_and_range():
    with pytest.raises(ValueError, match=r"bandwidth = -1 Hz is outside \[0\.1, 1000\] Hz"):
        RequirementLimits(bandwidth=-1.0)


def test_free_play_sigma_is_that_of_the_backlash_times_its_slope(requirements):
    P = covariance()
    P[1, 1] = 0.03**2
    item = health_of(requirements, fault_vector({"backlash": 0.3}), P)["free_play"]
    assert item.sigma == pytest.approx(ACTUATOR.BLK * 99.0 * ACTUATOR.tau * 0.03, rel=1e-9)
    assert item.value == pytest.approx(ACTUATOR.BLK * (1 + 99 * 0.3) * ACTUATOR.tau)
    assert (item.limit, item.limit_is_lower) == (5e-4, False)


def test_sigma_is_the_spread_of_performance_over_samples_of_the_faults(requirements):
    k = fault_vector({"backlash": 0.2, "friction": 0.3, "gain": 0.3})
    P = np.diag([0.02, 0.02, 0, 0, 0, 0, 0, 0.02]) ** 2
    P[0, 1] = P[1, 0] = 0.8 * 0.02**2
    samples = np.random.default_rng(2).multivariate_normal(k, P, 2000)
    performance = requirements.model.performance(samples)
    for item in requirements.judge(k, P).healths:
        spread = float(np.std(getattr(performance, item.name)))
        # 2,000 samples show a spread to 1.6 %, and curvature adds a little.
        assert item.sigma == pytest.approx(spread, rel=0.08)


def test_levels_go_from_ok_over_warn_to_error(requirements):
    levels = [
        health_of(requirements, fault_vector({"backlash": k}), covariance(0.005))["free_play"].level
        for k in (0.05, 0.25, 0.6)
    ]
    assert levels == [OK, WARN, ERROR]


def test_bandwidth_is_below_its_limit_when_it_fails():
    requirements = Requirements(ACTUATOR, RequirementLimits(bandwidth=25.0))
    item = health_of(requirements, fault_vector({"gain": 0.1}), covariance())["bandwidth"]
    assert item.limit_is_lower
    assert item.value < item.limit == 25.0
    assert item.level == ERROR


def test_unobservable_fault_hides_only_the_performance_it_matters_to(requirements):
    P = covariance()
    gain = FAULT_NAMES.index("gain")
    P[gain] = P[:, gain] = np.nan
    found = health_of(requirements, healthy_faults(), P)
    assert found["tracking_error"].level == STALE
    assert np.isnan(found["tracking_error"].sigma)
    assert found["free_play"].level == OK
    assert np.isfinite(found["free_play"].sigma)


def test_direction_of_an_eccentricity_that_is_not_there_hides_nothing(requirements):
    for item in requirements.judge(healthy_faults(), without_phase(1e-3)).healths:
        assert item.level == OK
        assert np.isfinite(item.sigma)


def test_direction_of_a_large_eccentricity_matters_to_the_torque(requirements):
    faults = fault_vector({"eccentricity": 0.4, "short_circuit_a": 0.2})
    found = health_of(requirements, faults, without_phase(1e-3))
    assert found["torque_margin"].level == STALE
    assert found["free_play"].level == OK


def test_unknown_faults_leave_every_requirement_stale(requirements):
    for item in requirements.judge(np.full(8, np.nan), np.full((8, 8), np.nan)).healths:
        assert item.level == STALE
        assert np.isnan(item.value)


@pytest.mark.parametrize("name", MODELLED)
def test_surrogate_is_right_near_its_known_points(requirements, name):
    known = np.clip(healthy_faults() + 0.05 * np.random.default_rng(6).random((40, 8)), 0.0, 1.0)
    near = known + 0.005
    surrogate = Surrogate(known, requirements.exact_reserves((name,), known)[:, 0])
    right = requirements.exact_reserves((name,), near)[:, 0]
    assert np.sqrt(np.mean((surrogate.at(near) - right) ** 2)) < 0.015
