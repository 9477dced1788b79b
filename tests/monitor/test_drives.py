"""One step of the two current loops, against figures worked out by hand."""

import math

import numpy as np
import pytest

from ema_core.parameters import ActuatorParameters, constants
from ema_monitor.model import drives

BC, AB, AC = 0, 1, 2
MOTOR = constants(ActuatorParameters()).motor


def position(theta_e):
    return drives.pair_position(theta_e / math.pi)


def fast_drive(motor, I, I_ref, omega, theta_m, dt):
    drive = drives.fast_constants(motor, dt, 0.0)
    pair = drives.pair_at(drive, theta_m)
    return drives.fast_drive(drive, pair, math.cos(theta_m), math.sin(theta_m), I, I_ref, omega)


def source_drive(motor, I, I_ref, omega, theta_m, dt):
    drive, theta_e = drives.source_constants(motor, dt), motor.P * theta_m
    return drives.source_drive(
        drive, position(theta_e), math.cos(theta_e), math.sin(theta_e), I, I_ref, omega
    )


@pytest.mark.parametrize(
    ("from_degrees", "to_degrees", "pair"),
    # Eq. 4.12, and the next two half turns: the pair does not tell which way the current flows.
    [(-30, 30, BC), (30, 90, AB), (90, 150, AC), (150, 210, BC), (210, 270, AB), (-90, -30, AC)],
)
def test_pair_is_that_of_equation_4_12(from_degrees, to_degrees, pair):
    # 1e-9 degrees is far beyond rounding; on the very edge either pair is right.
    for degrees in (from_degrees + 1e-9, (from_degrees + to_degrees) / 2, to_degrees - 1e-9):
        for turns in (-7, 0, 500):
            theta_e = math.radians(degrees) + 2 * math.pi * turns
            assert drives.of_pair(position(theta_e), (BC, AB, AC)) == pair


def test_pair_holds_up_to_where_the_next_one_begins():
    motor = MOTOR._replace(N_a=0.9, N_b=0.7, N_c=0.4)
    drive = drives.fast_constants(motor, 2e-5)
    for theta_m in np.linspace(-7.0, 7.0, 1001):
        pair = drives.pair_at(drive, theta_m)
        assert pair.lowest <= theta_m < pair.highest
        assert pair.highest - pair.lowest == pytest.approx(math.pi / 3.0 / motor.P)
        for within in (pair.lowest + 1e-9, pair.highest - 1e-9):
            assert drives.pair_at(drive, within)[2:] == pair[2:]
        assert drives.pair_at(drive, pair.highest + 1e-9).R != pair.R


# theta_e, phi and 1 - 0.42 (cos(theta_e + phi) + sawtooth sin(theta_e - pi)), to five digits; the
# sawtooth is 1 at multiples of 60 degrees, 0.5 at 45, 1.5 at 75 degrees.
EQUATION_4_24 = [
    (0, 0, 0.58),
    (45, 0, 0.85151),
    (60, 0, 1.15373),
    (75, 0, 1.49983),
    (120, 0, 1.57373),
    (240, 0, 0.84627),
    (60, 90, 1.72746),
    (-60, -90, 1.0),
]


def test_delay_of_the_current_loop_lets_the_current_fall_and_the_ripple_rise():
    """By back-EMF and resistance, and by the supply, within the delay (M12)."""
    p, I, omega, delay, dt = ActuatorParameters(), 5.0, 200.0, 2e-5, 1e-5
    drive = drives.fast_constants(MOTOR, dt, 0.0, delay)
    pair = drives.pair_at(drive, 0.0)
    settled, torque, ripple = drives.fast_drive(drive, pair, 1.0, 0.0, I, I, omega)
    assert I - settled == pytest.approx(delay / p.L_s * (p.R_s * I + p.k_e * omega), rel=1e-12)
    assert torque == pytest.approx(p.k_e * settled, rel=1e-12)
    assert ripple == pytest.approx(p.k_e * (p.h_b + delay / p.L_s * p.V_max), rel=1e-12)


@pytest.mark.parametrize(("theta_e", "phi", "factor"), EQUATION_4_24)
def test_source_eccentricity_is_equation_4_24(theta_e, phi, factor):
    motor = MOTOR._replace(zeta=1.0, phi=math.radians(phi))
    theta_m = math.radians(theta_e) / motor.P
    I, torque, _ = source_drive(motor, 5.0, 5.0, 0.0, theta_m, 1e-6)
    assert torque / (motor.G_M * I) == pytest.approx(factor, abs=1e-5)
    # The back-EMF has the same factor: without an error of current it alone drives, with the drop.
    dt, omega = 1e-6, 100.0
    turning, _, _ = source_drive(motor, 5.0, 5.0, omega, theta_m, dt)
    back_emf = (I - turning) * motor.L_s / dt
    # The two currents agree to five digits, which leaves their difference eleven less five.
    assert back_emf == pytest.approx(motor.k_e * factor * omega, rel=2e-5)


@pytest.mark.parametrize(
    ("theta_e", "f"), [(0, (0.5 + 0.25) / 2), (60, (0.8 + 0.5) / 2), (120, (0.8 + 0.25) / 2)]
)
def test_source_short_circuit_scales_torque_resistance_and_inductance(theta_e, f):
    motor = MOTOR._replace(N_a=0.8, N_b=0.5, N_c=0.25)
    theta_m, dt = math.radians(theta_e) / motor.P, 1e-6
    I, torque, ripple = source_drive(motor, 5.0, 5.0, 0.0, theta_m, dt)
    assert torque == pytest.approx(motor.G_M * f * I, rel=1e-12)
    # Without an error of current the voltage is off, and the current decays with R f over L N^2.
    L = motor.L_s * (0.8**2 + 0.5**2 + 0.25**2) / 3
    assert (5.0 - I) / dt == pytest.approx(5.0 * motor.R_s * f / L, rel=1e-9)
    assert ripple == 0.0


@pytest.mark.parametrize(("start", "I_ref", "voltage"), [(0.0, 50.0, 48.0), (12.0, -50.0, -48.0)])
@pytest.mark.parametrize("omega", [0.0, 150.0])
@pytest.mark.parametrize(
    ("theta_e", "N_1", "N_2"), [(0, 0.5, 0.25), (60, 0.8, 0.5), (120, 0.8, 0.25)]
)
def test_supply_limits_the_slope_of_the_current(start, I_ref, voltage, omega, theta_e, N_1, N_2):
    """A reference out of reach: the driven pair's R and L answer the full supply's step."""
    motor = MOTOR._replace(N_a=0.8, N_b=0.5, N_c=0.25)
    R = motor.R_s / 2 * (N_1 + N_2)
    L = motor.L_s / 2 * (N_1**2 + N_2**2)
    K = motor.k_e / 2 * (N_1 + N_2)
    final = (voltage - K * omega) / R
    dt, current, torque = 1e-7, start, 0.0
    theta_m = math.radians(theta_e) / motor.P
    for n in range(1, 1001):
        current, torque, _ = fast_drive(motor, current, I_ref, omega, theta_m, dt)
        change = (start - final) * math.exp(-n * dt * R / L)
        # Euler's error is this change times n (dt R / L)^2 / 2 and terms of higher order.
        tolerance = 0.6 * abs(change) * n * (dt * R / L) ** 2
        assert current - final == pytest.approx(change, abs=tolerance)
    limited = max(-motor.T_max, min(motor.T_max, K * current))
    assert torque == pytest.approx(limited, rel=1e-12)


@pytest.mark.parametrize(
    ("theta_e", "first", "second"), [(0, "b", "c"), (60, "a", "b"), (120, "a", "c")]
)
def test_fast_torque_constant_is_that_of_the_driven_pair(theta_e, first, second):
    """Eq. 3.3 of the pair's two phases; the third leaves no trace."""
    N = {"a": 0.9, "b": 0.7, "c": 0.4}
    zeta, phi = 0.6, 0.7
    motor = MOTOR._replace(N_a=N["a"], N_b=N["b"], N_c=N["c"], zeta=zeta, phi=phi)
    theta_m = math.radians(theta_e) / motor.P
    gap = {x: 1 + zeta * math.cos(theta_m + phi + 2 * math.pi / 3 * "abc".index(x)) for x in N}
    K = motor.k_e / 2 * (N[first] * gap[first] + N[second] * gap[second])
    _, torque, ripple = fast_drive(motor, 2.0, 2.01, 0.0, theta_m, 2e-5)
    assert torque == pytest.approx(K * 2.01, rel=1e-12)
    assert ripple == pytest.approx(K * motor.h_b, rel=1e-12)


def lifted(motor, lift, theta_e, I):
    drive = drives.fast_constants(motor, 2e-5, lift)
    return drives.lifted_current(drive, drives.pair_at(drive, theta_e / motor.P), I)


def test_lift_follows_the_current_within_the_hysteresis_band_and_no_further():
    h_b = MOTOR.h_b
    shares = {-9.0: -1.0, -h_b: -1.0, -h_b / 4: -0.25, 0.0: 0.0, h_b / 2: 0.5, h_b: 1.0, 9.0: 1.0}
    for I, share in shares.items():
        assert lifted(MOTOR, 0.2, 0.3, I) == pytest.approx(I + 0.2 * share, rel=1e-14)


@pytest.mark.parametrize(("theta_e", "contrast"), [(0, -0.425), (60, 0.4), (120, 0.025)])
def test_idle_phase_with_fewer_turns_than_the_pair_lifts_more(theta_e, contrast):
    """Mean of the pair's healthy fractions, BC, AB and AC, less that of the phase left over."""
    motor = MOTOR._replace(N_a=0.8, N_b=0.5, N_c=0.25)
    lift = 0.2 * (1 + drives.IDLE_CONTRAST * contrast)
    assert lifted(motor, 0.2, math.radians(theta_e), 7.0) == pytest.approx(7.0 + lift, rel=1e-12)
