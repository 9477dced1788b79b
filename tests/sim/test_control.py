"""Position and speed loop at work: gains, limits, breakaway."""

import math

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP
from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, constants
from ema_sim.actuator import SimulatedActuator, at_rest
from ema_sim.reference import DT

from .trajectories import locked, run

ACTUATOR = ActuatorParameters()
# A narrow band and a slow current: the torque follows its reference to 0.2 %.
SMOOTH = ACTUATOR.replace({"h_b": 1e-3, "L_s": 0.02, "T_max": 10.0})
F_S = 0.1 * 1.689


@pytest.mark.slow
@pytest.mark.parametrize("k", [0.0, 0.25, 0.5, 1.0])
def test_gain_fault_moves_the_breakaway_command(k):
    """At rest T = GAP G_prop g command, and the motor starts where that is f_s."""
    plant = degrade(constants(SMOOTH), fault_vector({"gain": k}))
    breakaway = F_S / (0.05 * 1e5 * (0.5 + k))
    rate = breakaway / 0.02
    x = run(plant, at_rest(), 22_000, command=lambda t: rate * t)
    start = DT * (np.flatnonzero(x.omega)[0] - 1)
    # The ripple of the three currents moves the torque by k_t h_b plus a step's rise, 0.3 % of f_s.
    assert rate * start == pytest.approx(breakaway, rel=5e-3)


def test_gain_fault_has_no_say_where_the_speed_reference_is_limited():
    speeds = []
    for k in (0.0, 0.5, 1.0):
        actuator = SimulatedActuator()
        actuator.faults = fault_vector({"gain": k})
        actuator.advance([1.0])  # on the way to 1 rad the reference passes the linear range
        speeds.append(actuator.advance(np.full(200, 1.0)).speed[-1])
    assert speeds[0] > 300.0
    # Nothing but the switching pattern of the first sample is left of the difference.
    np.testing.assert_allclose(speeds, speeds[0], rtol=1e-3)


@pytest.mark.parametrize("friction", [0.0, 0.25])
def test_chirp_starts_the_motor_some_milliseconds_late(friction):
    """Until 0.005 sin(2 pi 15 t^2) calls for the breakaway torque nothing moves."""
    actuator = SimulatedActuator()
    actuator.faults = fault_vector({"friction": friction})
    speed = actuator.advance(THESIS_CHIRP.sample(1e-4)).speed
    start = 1e-4 * np.flatnonzero(speed)[0]

    def time_of(torque: float) -> float:
        command = torque / (0.05 * 1e5)
        return math.sqrt(math.asin(command / 0.005) / (2 * math.pi * 15))

    f_s = F_S * (1 + 2 * friction)
    # Ripple brings the moment forward: one driven phase at the edge of its band and the other at
    # that of the double one are 1.5 k_e h_b more torque at most.
    assert time_of(f_s - 1.5 * 0.0752 * 0.5) - 2e-4 < start < time_of(f_s) + 2e-4


def test_integral_action_overcomes_stiction():
    """A stuck motor's torque grows by GAI times the error until it starts."""
    GAI = 2.0
    plant = constants(SMOOTH.replace({"GAI": GAI}))
    command = 0.7 * F_S / (0.05 * 1e5)
    error = 1e5 * command
    expected = (F_S - 0.05 * error) / (GAI * error)
    x = run(plant, at_rest(), round(1.1 * expected / DT), command=command)
    start = DT * np.flatnonzero(x.omega)[0]
    # 0.3 % of ripple in a torque of which 30 % is integral.
    assert start == pytest.approx(expected, rel=0.015)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_torque_is_limited(direction):
    plant = constants(ACTUATOR.replace({"T_max": 0.6}))
    x = run(plant, at_rest(), 3000, command=direction)
    assert np.abs(x.torque).max() == 0.6
    assert (x.torque == direction * 0.6).mean() > 0.5
    # The shaft has only what the limit lets through.
    m = plant.mechanics
    at_limit = np.flatnonzero(x.torque[1:] == direction * 0.6)
    acceleration = np.diff(x.omega)[at_limit] / DT
    expected = (0.6 * direction - m.f_d * direction - m.C * x.omega[:-1][at_limit]) / m.J
    # Breakaway included; the difference of two speeds of 50 rad/s over 1 us keeps nine digits.
    np.testing.assert_allclose(acceleration, expected, rtol=1e-6)


def test_current_reference_is_limited():
    limit = 6.0
    plant = locked(constants(ACTUATOR.replace({"I_max": limit})))
    x = run(plant, at_rest(), 4000, command=1.0)
    currents = np.abs([x.i_a, x.i_b, x.i_c])[:, 1000:]
    # The double band of a floating star, and a step's rise.
    assert currents.max() < limit + 1.0 + 0.11
    driven = currents[1:].mean(axis=1)
    np.testing.assert_allclose(driven, limit, atol=ACTUATOR.h_b)


def test_speed_reference_is_limited():
    """With voltage to spare the motor settles where the speed loop asks for the friction."""
    actuator = SimulatedActuator(ACTUATOR.replace({"V_max": 100.0}))
    speed = actuator.advance(np.full(3000, 1.15)).speed[-200:]
    m = constants(ACTUATOR).mechanics
    limit = 8000 / 60 * 2 * math.pi
    droop = (m.f_d + m.C * limit) / ACTUATOR.GAP
    # A current anywhere in its band, seen through k_t / GAP, and as much again for commutation.
    band = 2 * ACTUATOR.h_b * ACTUATOR.k_t / ACTUATOR.GAP
    np.testing.assert_allclose(speed, limit - droop, atol=band)


def test_position_comes_to_rest_within_what_friction_holds():
    """The loop without integral part stops inside the dead zone f_s / (GAP G_prop)."""
    for target in (0.004, -0.02):
        actuator = SimulatedActuator()
        telemetry = actuator.advance(np.full(1500, target))
        assert (telemetry.speed[-300:] == 0.0).all()
        assert abs(telemetry.position[-1] - target) < F_S / (0.05 * 1e5)
