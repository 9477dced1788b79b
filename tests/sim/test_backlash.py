"""The play between motor and output."""

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, constants
from ema_sim.actuator import SimulatedActuator, at_rest
from ema_sim.reference import DT

from .trajectories import run, unpowered

ACTUATOR = ActuatorParameters(f_sm=0.0, f_su=0.0, C_m=0.0, C_u=0.0)
PLANT = constants(ActuatorParameters())


@pytest.mark.parametrize("k", [0.0, 0.1, 1.0])
def test_free_play_on_reversal(k):
    """On reversal the output waits until the motor has crossed the play, 1 + 99 k times BLK."""
    width = 5e-3 * (1 + 99 * k)
    plant = degrade(unpowered(constants(ACTUATOR)), fault_vector({"backlash": k}))
    omega = 1000 * width  # constant, without friction: the play is crossed in 1 ms
    there = run(plant, at_rest()._replace(omega=omega), 2000)
    x = there[-1]
    turned = at_rest(float(x.theta_m), float(x.theta_b))._replace(omega=-omega)
    back = run(plant, turned, 2000)
    waiting = np.flatnonzero(back.theta_b == back.theta_b[0])[-1]
    travel = back.theta_m[0] - back.theta_m[waiting]
    # The output starts within a step's motion, a thousandth of the play.
    assert travel == pytest.approx(width, abs=1.001 * omega * DT)
    # Exactly: at one motor angle the output differs by the play between the two directions.
    up, down = there.theta_m - there.theta_b, back.theta_m - back.theta_b
    assert up[-1] - down[-1] == pytest.approx(width, rel=1e-9)
    # Seen at the user shaft.
    lost = (there.theta_b[-1] - back.theta_b[-1]) * ACTUATOR.tau
    moved = (there.theta_m[-1] - back.theta_m[-1]) * ACTUATOR.tau
    assert moved - lost == pytest.approx(width * ACTUATOR.tau, rel=1e-9)


@pytest.mark.parametrize("k", [0.0, 0.3, 1.0])
def test_approach_leaves_the_gear_on_one_flank(k):
    """Wherever in its play the motor stood before, the test cycle starts pushing forwards."""
    cycle = build_cycle(THESIS_CHIRP, 1e-4)
    half = 2.5e-3 * (1 + 99 * k)
    for offset in (-1.0, 0.0, 1.0):
        actuator = SimulatedActuator()
        actuator.faults = fault_vector({"backlash": k})
        actuator.state = at_rest(0.0, offset * half)
        telemetry = actuator.advance(cycle.samples[: cycle.start + 1])
        # At rest throughout the hold before the command proper.
        assert (telemetry.speed[-500:] == 0.0).all()
        x = actuator.state
        assert x.theta_m - x.theta_b == pytest.approx(half, rel=1e-12)
