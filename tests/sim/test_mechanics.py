"""Friction, damping and end stops of the shaft, the motor cut off or at work."""

import math

import numpy as np
import pytest

from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, constants
from ema_sim.actuator import at_rest
from ema_sim.reference import DT

from .trajectories import run, unpowered

# Enough damping to matter beside the dry friction: 0.1 against 0.08 N.m at the start.
DAMPED = unpowered(constants(ActuatorParameters(C_m=0.01)))
PLANT = unpowered(constants(ActuatorParameters()))
OMEGA_0 = 10.0


def spinning(omega: float):
    return at_rest()._replace(omega=omega)


def test_coast_down_under_viscous_and_dry_friction():
    """J omega' = -C omega - f_d until it stands still, and the error is of first order."""
    m = DAMPED.mechanics
    stop_time = m.J / m.C * math.log(1 + OMEGA_0 * m.C / m.f_d)
    errors = []
    for dt in (4e-6, 2e-6, 1e-6):
        x = run(DAMPED, spinning(OMEGA_0), round(1.2 * stop_time / dt), dt=dt)
        t = dt * np.arange(len(x))
        omega = (OMEGA_0 + m.f_d / m.C) * np.exp(-m.C / m.J * t) - m.f_d / m.C
        errors.append(np.abs(x.omega - np.maximum(omega, 0.0)).max())
        # The step that would cross zero is cut short, so the stop is late by less than one step
        # more than Euler's own error.
        assert dt * np.argmin(x.omega) == pytest.approx(stop_time, abs=3 * dt)
        assert (x.omega[t > stop_time + 3 * dt] == 0.0).all()
        assert (np.diff(x.omega) <= 0.0).all()
    # Euler on exp(-t / T) with T = J / C: at most dt / (2 e T) of its amplitude.
    assert errors[-1] < 1.1 * (OMEGA_0 + m.f_d / m.C) * DT * m.C / m.J / (2 * math.e)
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 1.0, atol=0.1)


@pytest.mark.parametrize("k", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_sticks_below_breakaway_and_moves_above_it(k, direction):
    """A positive load pushes backwards; beyond breakaway only the dynamic friction is left."""
    plant = degrade(PLANT, fault_vector({"friction": k}))
    f_s = 0.1 * 1.689 * (1 + 2 * k)
    stuck = run(plant, at_rest(), 200, load=direction * f_s * (1 - 1e-9))
    assert (stuck.omega == 0.0).all()
    assert (stuck.theta_m == 0.0).all()
    load = direction * f_s * (1 + 1e-9)
    moving = run(plant, at_rest(), 200, load=load)
    acceleration = -(load - direction * f_s / 2) / 2.5e-5
    # In 200 us the damping takes C t / 2 J = 4e-5 of the speed away.
    assert moving.omega[-1] == pytest.approx(acceleration * 200 * DT, rel=1e-4)


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
