# SPDX-License-Identifier: Apache-2.0
"""The sinusoidal motor under field-oriented control, compared with closed forms (M33, M34)."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ema_core.current_loop import current_loop
from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_sim.actuator import SimulatedActuator
from ema_sim.field_oriented import FieldOrientedState

# k_t = 3/2 P lambda and k_e = sqrt(3) P lambda.
P = ActuatorParameters(k_t=0.0752 * math.sqrt(3.0) / 2.0)
LOOP = current_loop(P)
LOCKED = replace(P, f_sm=1e4)


def actuator(parameters=P, sample_period=1e-4, faults=None) -> SimulatedActuator:
    simulated = SimulatedActuator(parameters, sample_period=sample_period, drive="field_oriented")
    simulated.faults = fault_vector(faults or {})
    return simulated


def axes(x: FieldOrientedState, theta_m: float, poles: int = P.P) -> tuple[float, float]:
    """Return the currents of the axes d and q with the motor at an angle."""
    c, s = math.cos(poles * theta_m), math.sin(poles * theta_m)
    return -c * x.i_alpha - s * x.i_beta, s * x.i_alpha - c * x.i_beta


def torques_per_ampere(faults, steps=3000):
    """Return motor angle, current of the q axis and torque over steps of 1 us of a fast motion."""
    # Voltage and torque are large enough that neither is limited.
    simulated, rows = actuator(replace(P, V_max=300.0, T_max=10.0), 1e-6, faults), []
    simulated.advance(np.full(4000, 0.02))
    for _ in range(steps // 10):
        theta_m = simulated.state.theta_m
        simulated.advance([0.02])
        x = simulated.state
        rows.append((theta_m, *axes(x, theta_m), x.torque))
        simulated.advance(np.full(40, 0.02))
    return np.array(rows).T


def test_torque_is_three_halves_of_pole_pairs_flux_and_current():
    theta_m, _, i_q, torque = torques_per_ampere({})
    flux = P.k_e / (math.sqrt(3.0) * P.P)
    assert np.ptp(theta_m) > 1.0  # some electrical turns
    np.testing.assert_allclose(torque, 1.5 * P.P * flux * i_q, rtol=1e-9)
    np.testing.assert_allclose(torque, P.k_t * i_q, rtol=1e-9)


def test_eccentricity_makes_torque_per_ampere_a_wave_of_2_p_less_1_periods():
    """K (1 - zeta/2 cos(2 P theta_m - theta_m - phi)), whose mean is zero: the phases cancel it."""
    theta_m, i_d, i_q, torque = torques_per_ampere({"eccentricity": 0.4})
    wave = 1.0 - 0.2 * np.cos((2 * P.P - 1) * theta_m)
    largest = np.abs(i_q).max()
    # The current of the d axis, which the faults disturb, interacts with the other part of the
    # wave.
    assert np.abs(i_d).max() < 0.1 * largest
    np.testing.assert_allclose(torque, P.k_t * i_q * wave, atol=0.02 * P.k_t * largest)


def test_short_circuit_takes_its_share_of_the_mean_and_makes_a_wave_of_2_p_periods():
    """Sum of N_i sin^2: the mean is (N_a + N_b + N_c) / 3, the wave 1/3 of the missing turns."""
    theta_m, _, i_q, torque = torques_per_ampere({"short_circuit_a": 0.3})
    expected = 0.9 + 0.1 * np.cos(2 * P.P * theta_m)
    np.testing.assert_allclose(
        torque, P.k_t * i_q * expected, atol=0.01 * P.k_t * np.abs(i_q).max()
    )


def test_current_responds_as_a_first_order_lag_of_the_described_bandwidth():
    simulated = actuator(LOCKED, 1e-6)
    wanted = 5.0
    command = wanted * P.k_t / P.GAP / P.G_prop
    response = []
    for _ in range(600):
        simulated.advance([command])
        response.append(axes(simulated.state, 0.0)[1])
    # The command is 0 at the start of the first step. An implicit step lags by half a step, 0.3 %.
    t = 1e-6 * np.arange(600)
    np.testing.assert_allclose(
        response, wanted * (1.0 - np.exp(-P.omega_c * t)), atol=0.004 * wanted
    )


def test_steady_speed_is_where_the_speed_loop_balances_friction():
    """GAP (omega_max - omega) = f_d + C omega, if the voltage suffices."""
    fast = replace(P, V_max=200.0, theta_stop=100.0)
    simulated = actuator(fast)
    simulated.advance(np.full(6000, 50.0))
    f_d, C = fast.f_ratio * (fast.f_sm + fast.f_su), fast.C_m + fast.C_u
    expected = (fast.GAP * fast.omega_max - f_d) / (fast.GAP + C)
    assert simulated.state.omega == pytest.approx(expected, rel=1e-6)


def test_supply_power_equals_shaft_power_and_copper_loss():
    simulated = actuator(replace(P, V_max=200.0, theta_stop=100.0))
    simulated.advance(np.full(6000, 50.0))
    x = simulated.state
    i_d, i_q = axes(x, x.theta_m)
    assert isinstance(x, FieldOrientedState)
    omega_e, R = P.P * x.omega, 0.5 * P.R_s
    v_d = x.z_d - LOOP.K_p * i_d - omega_e * LOOP.L * i_q
    # The speed loop commands the steady current.
    v_q = x.z_q + omega_e * LOOP.L * i_d + LOOP.k * x.omega
    supplied = 1.5 * (v_d * i_d + v_q * i_q)
    # A step turns the axes by P omega dt = 0.002 rad.
    assert supplied == pytest.approx(x.torque * x.omega + 1.5 * R * (i_d**2 + i_q**2), rel=5e-3)


@pytest.mark.parametrize("name", ["dead_time", "dead_switch"])
def test_causes_of_a_switching_inverter_are_refused_by_name(name):
    simulated = actuator()
    with pytest.raises(ValueError, match=f"{name}: the inverter of a field_oriented drive"):
        simulated.causes = {name: 1e-6 if name == "dead_time" else 1.0}
    assert simulated.causes == {}
