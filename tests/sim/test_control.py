"""Position and speed loop at work: gains, limits, breakaway."""

import numpy as np
import pytest

from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, constants
from ema_sim.actuator import SimulatedActuator, at_rest
from ema_sim.reference import DT

from .trajectories import run

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


def test_position_comes_to_rest_within_what_friction_holds():
    """The loop without integral part stops inside the dead zone f_s / (GAP G_prop)."""
    for target in (0.004, -0.02):
        actuator = SimulatedActuator()
        telemetry = actuator.advance(np.full(1500, target))
        assert (telemetry.speed[-300:] == 0.0).all()
        assert abs(telemetry.position[-1] - target) < F_S / (0.05 * 1e5)
