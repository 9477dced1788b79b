# SPDX-License-Identifier: Apache-2.0
"""Effects of faults on required performance, its limits, its health, and its failure."""

import numpy as np
import pytest

import ema_monitor.prognosis.requirements.performance as requirements_performance
from ema_core.commands import THESIS_CHIRP, Command
from ema_core.faults import FAULT_NAMES, HIGHEST, fault_vector, healthy_faults
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.health import HealthLimits
from ema_monitor.model.monitor_model import MonitorModel
from ema_monitor.prognosis.requirements.performance import HALF_POWER, PerformanceModel
from ema_monitor.prognosis.requirements.required_life import (
    failure_hours,
    limit_passage,
    lives_by_requirements,
)
from ema_monitor.prognosis.requirements.requirements import (
    REQUIREMENTS,
    RequirementLimits,
    Requirements,
)
from ema_monitor.windows.window import Window

ACTUATOR = ActuatorParameters()
PHASE = FAULT_NAMES.index("eccentricity_phase")


def covariance(sigma=0.01):
    return sigma**2 * np.eye(8)


def without_phase(sigma):
    """Return the covariance in which the direction of eccentricity is unobservable."""
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


def test_healthy_performance_equals_the_documented_values(requirements):
    healthy = requirements.healthy
    assert healthy["tracking_error"] == pytest.approx(2.14e-3, abs=5e-6)
    assert healthy["bandwidth"] == pytest.approx(32.9, abs=0.1)
    assert healthy["free_play"] == pytest.approx(1e-5)
    assert healthy["torque_margin"] == pytest.approx(0.653, abs=1e-3)


def test_limit_that_a_healthy_actuator_misses_is_refused_with_both_values():
    with pytest.raises(ValueError, match=r"torque_margin: .* 0\.653 1 and misses .* 0\.9 1"):
        Requirements(ACTUATOR, RequirementLimits(torque_margin=0.9))


def test_free_play_sigma_is_the_backlash_sigma_times_its_slope(requirements):
    P = covariance()
    P[1, 1] = 0.03**2
    item = health_of(requirements, fault_vector({"backlash": 0.3}), P)["free_play"]
    assert item.sigma == pytest.approx(ACTUATOR.BLK * 99.0 * ACTUATOR.tau * 0.03, rel=1e-9)
    assert item.value == pytest.approx(ACTUATOR.BLK * (1 + 99 * 0.3) * ACTUATOR.tau)
    assert (item.limit, item.limit_is_lower) == (5e-4, False)


def test_sigma_equals_the_spread_of_performance_over_samples_of_the_faults(requirements):
    k = fault_vector({"backlash": 0.2, "friction": 0.3, "gain": 0.3})
    P = np.diag([0.02, 0.02, 0, 0, 0, 0, 0, 0.02]) ** 2
    P[0, 1] = P[1, 0] = 0.8 * 0.02**2
    samples = np.random.default_rng(2).multivariate_normal(k, P, 2000)
    performance = requirements.model.performance(samples)
    for item in requirements.judge(k, P).healths:
        spread = float(np.std(getattr(performance, item.name)))
        # 2,000 samples determine a spread to 1.6 %, and curvature adds a little.
        assert item.sigma == pytest.approx(spread, rel=0.08)


def test_levels_rise_from_ok_over_warn_to_error(requirements):
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


def test_unobservable_fault_hides_only_the_performance_that_it_affects(requirements):
    P = covariance()
    gain = FAULT_NAMES.index("gain")
    P[gain] = P[:, gain] = np.nan
    health = health_of(requirements, healthy_faults(), P)
    assert health["tracking_error"].level == STALE
    assert np.isnan(health["tracking_error"].sigma)
    assert health["free_play"].level == OK
    assert np.isfinite(health["free_play"].sigma)


def test_direction_of_an_absent_eccentricity_hides_nothing(requirements):
    for item in requirements.judge(healthy_faults(), without_phase(1e-3)).healths:
        assert item.level == OK
        assert np.isfinite(item.sigma)


def test_direction_of_a_large_eccentricity_affects_the_torque(requirements):
    faults = fault_vector({"eccentricity": 0.4, "short_circuit_a": 0.2})
    health = health_of(requirements, faults, without_phase(1e-3))
    assert health["torque_margin"].level == STALE
    assert health["free_play"].level == OK


def test_unknown_faults_make_every_requirement_stale(requirements):
    for item in requirements.judge(np.full(8, np.nan), np.full((8, 8), np.nan)).healths:
        assert item.level == STALE
        assert np.isnan(item.value)


@pytest.fixture
def model(requirements):
    return requirements.model


def along(name, values):
    faults = np.tile(healthy_faults(), (len(values), 1))
    faults[:, FAULT_NAMES.index(name)] = values
    return faults


def moved_by_monitor_model(command: Command, faults, dt):
    """Return user-shaft angle [rad] and motor speed [rad/s] of the monitor model for each step."""
    samples = np.concatenate([[0.0], command.sample(dt)])
    rest = np.zeros(len(samples))
    window = Window(Telemetry(0, dt, 1, samples, rest, rest, rest))
    speed = MonitorModel(ACTUATOR, "fast", dt).respond(window, faults).speed[0]
    half = 0.5 * ACTUATOR.BLK * (1.0 + 99.0 * faults[1])
    output, angle = np.empty(len(speed)), 0.0
    for k, motor in enumerate(dt * np.cumsum(speed)):
        angle = min(max(angle, motor - half), motor + half)
        output[k] = angle
    return samples[1:], ACTUATOR.tau * output, speed


@pytest.mark.parametrize(
    "faults", [{}, {"backlash": 0.3}, {"friction": 0.4, "gain": 0.2, "short_circuit_b": 0.2}]
)
def test_tracking_error_equals_that_of_the_monitor_model(model, faults):
    k = fault_vector(faults)
    command, position, _ = moved_by_monitor_model(THESIS_CHIRP, k, model.dt)
    expected = np.abs(command - position).max()
    # The monitor interpolates the command linearly between samples, an error of 0.1 um.
    assert model.performance(k).tracking_error[0] == pytest.approx(expected, rel=1e-3)


def test_healthy_torque_margin_follows_from_newton_and_ohm(model):
    p = ACTUATOR
    _, _, speed = moved_by_monitor_model(THESIS_CHIRP, healthy_faults(), model.dt)
    omega, before = speed[1:], speed[:-1]
    turning = (omega != 0.0) & (before != 0.0)
    J, C, f_d = p.J_m + p.J_u, p.C_m + p.C_u, p.f_ratio * (p.f_sm + p.f_su)
    torque = J * (omega - before) / model.dt + C * before + f_d * np.sign(before)
    left = (p.V_max - np.sign(torque) * p.k_e * before) / p.R_s
    available = p.k_e * np.minimum(left, min(p.I_max, p.T_max / p.k_e))
    needed = (np.abs(torque) / available)[turning].max()
    # The step from a standstill may need the most torque; this sum does not include it.
    assert model.healthy["torque_margin"] == pytest.approx(1.0 - needed, abs=0.005)


@pytest.mark.parametrize("faults", [{}, {"gain": 0.0}, {"friction": 0.5}, {"eccentricity": 0.6}])
def test_amplitude_of_a_steady_sine_falls_by_3_db_at_the_bandwidth(model, faults):
    k = fault_vector(faults)
    frequency = float(model.performance(k).bandwidth[0])
    # Whole periods of 200 samples: the last four of ten have settled.
    dt = 1.0 / (200 * round(1.0 / (200 * 2e-5 * frequency) + 0.5) * frequency)
    per_period = round(1.0 / (frequency * dt))
    sine = Command(shape="sine", duration=10 / frequency, start_frequency=frequency)
    _, position, _ = moved_by_monitor_model(sine, k, dt)
    phase = 2 * np.pi * np.arange(1, len(position) + 1) / per_period
    settled = slice(6 * per_period, 10 * per_period)
    fundamental = 2 * np.mean((position * np.exp(-1j * phase))[settled])
    ratio = abs(fundamental) / sine.amplitude
    # A difference of 5 % in frequency between a sweep and steady sines is at most 5 % in amplitude.
    assert ratio == pytest.approx(HALF_POWER, rel=0.05)


@pytest.mark.parametrize(
    ("fault", "values", "performance", "sense"),
    [
        ("gain", np.linspace(0.5, 0.0, 6), "bandwidth", -1),
        ("gain", np.linspace(0.5, 0.0, 6), "tracking_error", 1),
        ("friction", np.linspace(0.0, 1.0, 6), "torque_margin", -1),
        ("friction", np.linspace(0.0, 1.0, 6), "tracking_error", 1),
        ("backlash", np.linspace(0.0, 1.0, 6), "torque_margin", -1),
        ("backlash", np.linspace(0.0, 1.0, 6), "free_play", 1),
        ("short_circuit_a", np.linspace(0.0, 0.9, 6), "torque_margin", -1),
        ("eccentricity", np.linspace(0.0, 1.0, 6), "torque_margin", -1),
    ],
)
def test_performance_decreases_with_the_relevant_fault(model, fault, values, performance, sense):
    performance_values = getattr(model.performance(along(fault, values)), performance)
    assert np.all(sense * np.diff(performance_values) > 0.0)


def test_many_actuators_perform_as_each_alone(model):
    rng = np.random.default_rng(4)
    faults = 0.5 * rng.random((19, 8))
    together = model.performance(faults)
    for row in (0, 7, 18):
        alone = model.performance(faults[row])
        for name in together._fields:
            assert getattr(together, name)[row] == getattr(alone, name)[0]


def test_performance_with_unknown_faults_is_unknown_and_affects_no_other(model):
    faults = along("friction", [0.1, np.nan, 0.1])
    performance = model.performance(faults)
    for name in ("tracking_error", "bandwidth", "torque_margin"):
        values = getattr(performance, name)
        assert np.isnan(values[1])
        assert np.isfinite(values[[0, 2]]).all()


def test_faults_beyond_their_range_count_as_at_its_end(model):
    for values in model.performance(along("gain", [-0.3, 0.0])):
        assert values[0] == values[1]


def test_step_of_50_us_gives_the_result_of_2_us(monkeypatch):
    faults = np.concatenate([along("backlash", [0.0, 0.3]), along("gain", [0.1])])
    coarse = PerformanceModel(ACTUATOR).performance(faults)
    monkeypatch.setattr(requirements_performance, "LONGEST_STEP", 2e-6)
    fine = PerformanceModel(ACTUATOR).performance(faults)
    np.testing.assert_allclose(coarse.tracking_error, fine.tracking_error, rtol=0.005)
    np.testing.assert_allclose(coarse.bandwidth, fine.bandwidth, rtol=0.01)
    np.testing.assert_allclose(coarse.torque_margin, fine.torque_margin, atol=0.004)


def test_requested_bandwidth_out_of_range_is_refused_by_value():
    with pytest.raises(ValueError, match=r"bandwidth_sought = 0\.0 Hz"):
        PerformanceModel(ACTUATOR, 0.0)


def test_faults_of_a_wrong_length_are_refused(model):
    with pytest.raises(ValueError, match="8 components"):
        model.performance(np.zeros(7))


HOURS = np.linspace(0.0, 1000.0, 61)


def growing(name, end, seed, n=100):
    """Return samples of one fault that grows, with curvature and scatter, to about `end`.

    The other faults grow a little.
    """
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
def test_first_failure_equals_that_of_the_model_at_every_hour(requirements, fault, end, failing):
    future = growing(fault, end, seed=3)
    actual = failure_hours(requirements, future, HOURS)
    for name in failing:
        expected = by_brute_force(requirements, future, name)
        both = np.isfinite(expected) & np.isfinite(actual[name])
        assert both.sum() > 40
        missed = actual[name][both] - expected[both]
        # Twice the largest difference over twelve such sets of samples.
        assert np.sqrt(np.mean(missed**2)) < 0.04 * np.median(expected[both])
        estimated, right = (
            np.quantile(np.minimum(lives, HOURS[-1]), [0.05, 0.5, 0.95], method="inverted_cdf")
            for lives in (actual[name], expected)
        )
        np.testing.assert_allclose(estimated, right, rtol=0.035)


@pytest.mark.slow
def test_low_gain_ends_life_by_tracking_and_bandwidth_if_these_are_strict():
    strict = Requirements(ACTUATOR, RequirementLimits(tracking_error=0.5e-3, bandwidth=25.0))
    future = growing("gain", 0.5, seed=8)
    failures = failure_hours(strict, future, HOURS)
    for name in ("tracking_error", "bandwidth"):
        expected = by_brute_force(strict, future, name)
        np.testing.assert_allclose(failures[name], expected, rtol=0.01)


def test_free_play_fails_at_the_closed_form_hour(requirements):
    limit = (5e-4 / (ACTUATOR.BLK * ACTUATOR.tau) - 1.0) / 99.0
    future = np.tile(healthy_faults(), (1, len(HOURS), 1))
    future[0, :, 1] = HOURS / 1000.0
    [hours] = failure_hours(requirements, future, HOURS)["free_play"]
    assert hours == pytest.approx(1000.0 * limit, rel=1e-9)


def test_constant_healthy_faults_violate_no_requirement(requirements):
    future = np.tile(healthy_faults(), (20, len(HOURS), 1))
    failures = failure_hours(requirements, future, HOURS)
    assert all(np.isinf(failures[name]).all() for name in REQUIREMENTS)


def test_requirement_that_fails_already_fails_at_once(requirements):
    future = np.tile(healthy_faults(), (20, len(HOURS), 1))
    future[:, :, 1] = 0.8
    failures = failure_hours(requirements, future, HOURS)
    assert not failures["free_play"].any()
    assert not failures["torque_margin"].any()


def test_sample_reaches_a_fault_limit_with_its_first_component():
    hours = np.linspace(0.0, 100.0, 33)
    rng = np.random.default_rng(0)
    paths = np.tile(healthy_faults(), (200, 33, 1))
    ends = rng.uniform(20.0, 80.0, (2, 200))
    paths[..., FAULT_NAMES.index("gain")] -= 0.25 * hours / ends[0, :, None]
    paths[..., FAULT_NAMES.index("friction")] += 0.5 * hours / ends[1, :, None]
    passages = limit_passage(paths, hours, HealthLimits())
    np.testing.assert_allclose(passages, ends.min(axis=0), rtol=1e-9)
    still = np.tile(healthy_faults(), (3, 33, 1))
    assert np.all(np.isinf(limit_passage(still, hours, HealthLimits())))
    gone = still + 0.0
    gone[0, :, FAULT_NAMES.index("friction")] = 0.6
    np.testing.assert_array_equal(limit_passage(gone, hours, HealthLimits()), [0.0, np.inf, np.inf])
    # A fault at the end of its range has reached any limit there.
    gone[0, :, FAULT_NAMES.index("friction")] = 1.0
    assert limit_passage(gone, hours, HealthLimits(friction=1.0))[0] == 0.0


@pytest.fixture
def failures():
    """Return failures: free play fails first in 60 of 100 samples, torque margin in the others."""
    failures = {name: np.full(100, np.inf) for name in REQUIREMENTS}
    failures["free_play"] = np.linspace(100.0, 199.0, 100)
    failures["torque_margin"] = np.where(np.arange(100) < 60, 500.0, 50.0)
    return failures


def test_first_failure_is_the_earliest_in_each_sample(failures):
    lives, overall, dominant = lives_by_requirements(failures, RequirementLimits(), 1000.0)
    assert dominant == "free_play"
    assert overall.criterion == lives["free_play"].criterion == "free play exceeds 0.0005 rad"
    assert (overall.hours_05, overall.hours_50, overall.hours_95) == (50.0, 109.0, 154.0)
    assert (lives["free_play"].hours_50, lives["torque_margin"].hours_50) == (149.0, 500.0)


def test_life_is_unknown_if_less_than_half_of_the_samples_fail(failures):
    failures["free_play"][:] = np.inf
    failures["torque_margin"] = np.where(np.arange(100) < 51, np.inf, 50.0)
    lives, overall, dominant = lives_by_requirements(failures, RequirementLimits(), 1000.0)
    for life in (*lives.values(), overall):
        assert not life.known
        assert np.isnan(life.hours_50)
        assert life.reason == "not within the horizon of 1000 h"
    assert dominant == ""
