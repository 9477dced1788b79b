"""Friction, damping and end stops of the shaft, the motor cut off or at work."""

import math

import numpy as np
import pytest

from ema_core.parameters import ActuatorParameters, constants
from ema_sim.actuator import at_rest
from ema_sim.reference import DT

from .trajectories import run, unpowered

# Enough damping to matter beside the dry friction: 0.1 against 0.08 N.m at the start.
DAMPED = unpowered(constants(ActuatorParameters(C_m=0.01)))
PLANT = unpowered(constants(ActuatorParameters()))


def spinning(omega: float):
    return at_rest()._replace(omega=omega)


@pytest.mark.parametrize("plant", [PLANT, DAMPED], ids=["dry", "damped"])
def test_friction_dissipates(plant):
    """Friction takes at least f_d times the way from the work of the load, and a stop takes all."""
    x = run(plant, at_rest(), 10_000, load=lambda t: 0.4 * math.sin(2500 * t))
    assert np.abs(x.omega).max() > 5.0
    m = plant.mechanics
    way = np.abs(x.omega[1:] + x.omega[:-1]) / 2 * DT
    work = -0.4 * np.sin(2500 * DT * np.arange(10_000)) * (x.omega[1:] + x.omega[:-1]) / 2 * DT
    loss = work - m.J / 2 * np.diff(x.omega**2)
    # The mid-point makes the work of a constant force exact, so all that is left is rounding.
    moving = x.omega[1:] != 0.0
    assert (loss >= m.f_d * way * (1 - 1e-9))[moving].all()
    stopping = ~moving & (x.omega[:-1] != 0.0)
    assert stopping.sum() >= 3
    assert loss.sum() > 0.0
    # A stop comes from one step's worth of speed at most, whatever the load.
    highest = (0.4 + m.f_d) / m.J * DT
    assert np.abs(x.omega[:-1][stopping]).max() <= highest


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_end_stop_holds_and_lets_go(direction):
    plant = unpowered(constants(ActuatorParameters(theta_stop=1e-3)))
    stop, play = direction * 1e-3 / ActuatorParameters().tau, ActuatorParameters().BLK
    hit = run(plant, spinning(direction * 300.0), 4000, load=-direction * 0.5)
    assert np.abs(hit.theta_m).max() == abs(stop)
    assert (hit.theta_m[2500:] == stop).all()
    assert (hit.omega[2500:] == 0.0).all()
    # The stop acts before the backlash: the output stays half a play short of it.
    assert hit.theta_b[-1] == pytest.approx(stop - direction * play / 2, rel=1e-12)
    end = hit[-1]
    state = at_rest(float(end.theta_m), float(end.theta_b))
    left = run(plant, state, 1000, load=direction * 0.5)
    m = plant.mechanics
    # Free acceleration from rest; damping takes C t / 2 J = 2e-4 of it.
    expected = -direction * (0.5 - m.f_d) / m.J * 1e-3
    assert left.omega[-1] == pytest.approx(expected, rel=3e-4)
