"""What faults do to tracking, bandwidth, free play and torque margin."""

import numpy as np
import pytest

import ema_monitor.prognosis.requirements.performance as requirements_performance
from ema_core.commands import THESIS_CHIRP, Command
from ema_core.faults import FAULT_NAMES, fault_vector, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.model.monitor_model import MonitorModel
from ema_monitor.prognosis.requirements.performance import HALF_POWER, PerformanceModel
from ema_monitor.windows.window import Window

ACTUATOR = ActuatorParameters()


@pytest.fixture(scope="module")
def model():
    return PerformanceModel(ACTUATOR)


def along(name, values):
    faults = np.tile(healthy_faults(), (len(values), 1))
    faults[:, FAULT_NAMES.index(name)] = values
    return faults


def moved_by_monitor_model(command: Command, faults, dt):
    """User-shaft angle [rad] and motor speed [rad/s] of the monitor model, a sample a step."""
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


def test_free_play_is_the_backlash_at_the_user_shaft(model):
    k = np.array([0.0, 0.2, 1.0])
    expected = ACTUATOR.BLK * (1.0 + 99.0 * k) / 500.0
    np.testing.assert_allclose(
        model.performance(along("backlash", k)).free_play, expected, rtol=1e-12
    )


@pytest.mark.parametrize(
    "faults", [{}, {"backlash": 0.3}, {"friction": 0.4, "gain": 0.2, "short_circuit_b": 0.2}]
)
def test_tracking_error_is_that_of_the_monitor_model(model, faults):
    k = fault_vector(faults)
    command, position, _ = moved_by_monitor_model(THESIS_CHIRP, k, model.dt)
    expected = np.abs(command - position).max()
    # The monitor reads the command between samples by a straight line, which is 0.1 um off.
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
    # Where the step out of a standstill takes the most, that step is not in this sum.
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
    # 5 % of frequency, by which a sweep differs from steady sines, is at most 5 % of amplitude.
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
def test_performance_falls_with_the_fault_that_matters(model, fault, values, performance, sense):
    found = getattr(model.performance(along(fault, values)), performance)
    assert np.all(sense * np.diff(found) > 0.0)


def test_many_actuators_perform_as_each_alone(model):
    rng = np.random.default_rng(4)
    faults = 0.5 * rng.random((19, 8))
    together = model.performance(faults)
    for row in (0, 7, 18):
        alone = model.performance(faults[row])
        for name in together._fields:
            assert getattr(together, name)[row] == getattr(alone, name)[0]


def test_performance_of_unknown_faults_is_unknown_and_spoils_no_other(model):
    faults = along("friction", [0.1, np.nan, 0.1])
    found = model.performance(faults)
    for name in ("tracking_error", "bandwidth", "torque_margin"):
        values = getattr(found, name)
        assert np.isnan(values[1])
        assert np.isfinite(values[[0, 2]]).all()


def test_faults_beyond_their_range_count_as_at_its_end(model):
    for values in model.performance(along("gain", [-0.3, 0.0])):
        assert values[0] == values[1]


def test_step_of_50_us_tells_what_2_us_tells(monkeypatch):
    faults = np.concatenate([along("backlash", [0.0, 0.3]), along("gain", [0.1])])
    coarse = PerformanceModel(ACTUATOR).performance(faults)
    monkeypatch.setattr(requirements_performance, "LONGEST_STEP", 2e-6)
    fine = PerformanceModel(ACTUATOR).performance(faults)
    np.testing.assert_allclose(coarse.tracking_error, fine.tracking_error, rtol=0.005)
    np.testing.assert_allclose(coarse.bandwidth, fine.bandwidth, rtol=0.01)
    np.testing.assert_allclose(coarse.torque_margin, fine.torque_margin, atol=0.004)


def test_bandwidth_sought_is_refused_by_value():
    with pytest.raises(ValueError, match=r"bandwidth_sought = 0\.0 Hz"):
        PerformanceModel(ACTUATOR, 0.0)


def test_faults_of_another_length_are_refused(model):
    with pytest.raises(ValueError, match="8 components"):
        model.performance(np.zeros(7))
