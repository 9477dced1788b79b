# SPDX-License-Identifier: Apache-2.0
"""The monitor's field-oriented drive, compared with closed forms and the plant, and estimates."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ema_core.current_loop import current_loop
from ema_core.description import ActuatorDescription
from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, FieldOrientedParameters, constants
from ema_monitor.api import find_windows
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.model import field_oriented
from ema_monitor.model.monitor_model import MonitorModel
from ema_monitor.prognosis.requirements.performance import PerformanceModel
from ema_monitor.windows.band import band_limited, rms
from ema_sim.api import simulate

P = ActuatorParameters(k_t=0.0752 * math.sqrt(3.0) / 2.0, T_max=1.465)
UNIT = ActuatorDescription(serial_number="F-1", drive="field_oriented", parameters=P)
LOOP = current_loop(P)
DT = 1e-5


def drive_of(faults=None, dt=DT, delay=0.0) -> field_oriented.FieldOrientedDrive:
    motor = degrade(constants(P), fault_vector(faults or {})).motor
    return field_oriented.field_oriented_constants(motor, LOOP, dt, delay)


def step(drive, theta_m, currents, I_ref, omega):
    return field_oriented.field_oriented_drive(
        drive, 0.0, math.cos(theta_m), math.sin(theta_m), currents, I_ref, omega
    )


def constant_at(drive, theta_m):
    c, s = math.cos(theta_m), math.sin(theta_m)
    return field_oriented.torque_constant(
        drive, c, s, *field_oriented.times_angle(c, s, 2 * drive.poles)
    )


@pytest.mark.parametrize("number", [0, 1, 2, 7, 100])
def test_multiple_of_an_angle_follows_the_addition_theorems(number):
    c, s = field_oriented.times_angle(math.cos(0.7), math.sin(0.7), number)
    assert (c, s) == pytest.approx((math.cos(0.7 * number), math.sin(0.7 * number)), abs=1e-12)


def test_healthy_torque_constant_is_three_halves_of_pole_pairs_and_flux():
    flux = P.k_e / (math.sqrt(3.0) * P.P)
    for theta_m in np.linspace(-4.0, 4.0, 23):
        assert constant_at(drive_of(), theta_m) == pytest.approx(1.5 * P.P * flux, rel=1e-12)


def test_torque_constant_with_faults_is_the_sum_over_phases():
    """Sum of k N_i sin^2(P theta - a_i) (1 + zeta cos(theta + phi + a_i)) (M35)."""
    faults = {
        "short_circuit_a": 0.3,
        "short_circuit_c": 0.1,
        "eccentricity": 0.4,
        "eccentricity_phase": 0.7,
    }
    phi, k = 0.4 * math.pi, P.k_e / math.sqrt(3.0)
    for theta_m in np.linspace(-4.0, 4.0, 23):
        total = 0.0
        for N, a in zip((0.7, 1.0, 0.9), (0.0, 2 * math.pi / 3, 4 * math.pi / 3), strict=True):
            gap = 1.0 + 0.4 * math.cos(theta_m + phi + a)
            total += k * N * gap * math.sin(P.P * theta_m - a) ** 2
        assert constant_at(drive_of(faults), theta_m) == pytest.approx(total, rel=1e-12)


@pytest.mark.parametrize("delay", [0.0, 1e-4])
def test_current_of_a_locked_motor_is_a_first_order_lag(delay):
    """The lag follows from the described bandwidth; a loop delay adds to its time constant."""
    drive, dt = drive_of(dt=1e-6, delay=delay), 1e-6
    currents, response = (0.0, 0.0), []
    for _ in range(500):
        currents, _, _ = step(drive, 0.0, currents, 4.0, 0.0)
        response.append(currents[0])
    t = dt * np.arange(1, 501)
    exact = 4.0 * (1.0 - np.exp(-t / (1.0 / P.omega_c + delay)))
    # The memory of the loop lags by an Euler step: omega_c dt / 2.
    np.testing.assert_allclose(response, exact, atol=4.0 * 3e-3)


def test_torque_follows_from_the_current_and_power_is_balanced():
    """Supply power of the axis less copper and coil is T omega: its voltage constant is 2/3 K."""
    drive, I, omega, dt = drive_of({"short_circuit_b": 0.2}, dt=1e-9), 6.0, 150.0, 1e-9
    (after, _), torque, ripple = step(drive, 0.3, (I, 5.0), I, omega)
    K = constant_at(drive, 0.3)
    assert (torque, ripple) == (pytest.approx(K * after, rel=1e-12), 0.0)
    c, s = math.cos(0.3), math.sin(0.3)
    R = field_oriented.at_angle(drive.R, *field_oriented.times_angle(c, s, 2 * drive.poles))
    voltage = 5.0 + drive.k * omega
    stored = dt / drive.slew * (after - I) / dt * I
    assert 1.5 * voltage * I == pytest.approx(
        1.5 * R * I**2 + K * I * omega + 1.5 * stored, rel=1e-6
    )


def test_voltage_limits_the_slope_of_the_current():
    """(V_max / sqrt(3) - R I - k omega) / L, with the contribution of the other axis."""
    drive, I, omega = drive_of(dt=1e-9), 3.0, 200.0
    (after, _), _, _ = step(drive, 0.0, (I, 0.0), 20.0, omega)
    v_d = P.P * omega * LOOP.L * I
    most = math.sqrt(P.V_max**2 / 3.0 - v_d**2)
    slope = (most - 0.5 * P.R_s * I - LOOP.k * omega) / LOOP.L
    assert (after - I) / 1e-9 == pytest.approx(slope, rel=1e-4)


# Rms of the smoothed residual [A]; measured 0.002 to 0.008. The step of 10 us causes 0.002 of it.
# A fault off by 0.02 of its range leaves 0.02 to 0.05 A.
@pytest.mark.parametrize(
    "faults",
    [
        {},
        {"friction": 0.3},
        {"backlash": 0.3},
        {"gain": 0.6},
        {"eccentricity": 0.3, "eccentricity_phase": 0.8},
        {"short_circuit_a": 0.25},
        {"short_circuit_a": 0.5, "short_circuit_b": 0.3},
    ],
    ids=str,
)
def test_current_and_speed_agree_with_the_three_phases(faults):
    [window] = find_windows(simulate(faults, description=UNIT), description=UNIT)
    model = MonitorModel(P, "field_oriented")
    response = model.respond(window, fault_vector(faults), window.play or 0.0)
    assert rms(band_limited(window.current - response.current[0], 1e-4)) < 0.009
    assert rms(band_limited(window.telemetry.speed[1:] - response.speed[0], 1e-4)) < 0.08


@pytest.fixture(scope="module")
def calibration():
    telemetry = simulate(cycles=4, description=UNIT, current_noise=0.02, seed=4)
    return calibrate_model(find_windows(telemetry, description=UNIT), UNIT)


def test_calibration_has_a_bandwidth_but_neither_lift_nor_idle_phases(calibration, tmp_path):
    assert calibration.form == "field_oriented"
    assert calibration.unit.lift == 0.0
    assert "lift" not in str(calibration)
    assert "lift" not in calibration.not_learned
    calibration.save(tmp_path / "c.yaml")
    assert "omega_c" in (tmp_path / "c.yaml").read_text()
    loaded = Calibration.load(tmp_path / "c.yaml")
    assert loaded.calibration_id == calibration.calibration_id
    faster = replace(UNIT, parameters=replace(P, omega_c=2.0 * P.omega_c))
    assert ("omega_c", 2.0 * P.omega_c, P.omega_c) in loaded.unit_mismatch(faster)
    # The calibration of a six-step drive has none.
    builtin = Calibration.builtin()
    six_step = ActuatorDescription(parameters=ActuatorParameters(omega_c=1.0))
    assert builtin.unit_mismatch(six_step) == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    "faults",
    [
        {},
        {"friction": 0.25, "eccentricity": 0.1, "eccentricity_phase": 0.3},
        {"short_circuit_b": 0.1, "backlash": 0.2, "gain": 0.55},
    ],
    ids=str,
)
def test_faults_are_identified_within_three_sigma_without_others(calibration, faults):
    telemetry = simulate(faults, description=UNIT, current_noise=0.02, seed=11)
    [window] = find_windows(telemetry, description=UNIT)
    estimate = identify(window, UNIT, calibration)
    assert estimate.verdict == "valid", estimate.reason
    truth = fault_vector(faults)
    for name, value, true in zip(estimate.faults._fields, estimate.faults, truth, strict=True):
        sigma = getattr(estimate.sigma, name)
        if math.isfinite(sigma):
            assert abs(value - true) < 3.0 * sigma, name


def test_window_of_another_drive_is_refused_by_name(calibration, healthy_windows):
    estimate = identify(healthy_windows[0], ActuatorDescription(), calibration)
    assert "has drive 'six_step', the calibration is for 'field_oriented'" in estimate.reason


@pytest.mark.parametrize(
    ("drive", "form", "named"),
    [
        ("unknown", None, "no monitor model for drive 'unknown'"),
        ("field_oriented", "source", "form 'source' is not available for drive 'field_oriented'"),
        (
            "six_step",
            "field_oriented",
            "form 'field_oriented' is not available for drive 'six_step'",
        ),
    ],
)
def test_drive_without_a_model_is_refused_by_name(healthy_windows, drive, form, named):
    with pytest.raises(ValueError, match=named):
        calibrate_model(healthy_windows[:1], replace(ActuatorDescription(), drive=drive), form)


def test_performance_is_that_of_the_described_drive(calibration):
    """Mechanics and loops are the same, hence equal tracking; less phase voltage, less reserve."""
    mine = PerformanceModel(calibration.unit_parameters)
    assert isinstance(calibration.unit_parameters, FieldOrientedParameters)
    six_step = PerformanceModel(ActuatorParameters())
    tracking = mine.healthy["tracking_error"] / six_step.healthy["tracking_error"]
    assert tracking == pytest.approx(1.0, abs=0.05)
    assert 0.1 < mine.healthy["torque_margin"] < six_step.healthy["torque_margin"] + 0.1
