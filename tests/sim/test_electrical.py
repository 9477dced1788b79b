"""Stator and inverter: closed forms and invariants of the three phase currents."""

import math

import numpy as np
import pytest

from ema_core.parameters import ActuatorParameters, constants
from ema_sim.actuator import at_rest
from ema_sim.reference import DT

from .reference_twin import driven
from .trajectories import locked, run

ACTUATOR = ActuatorParameters()
PLANT = constants(ACTUATOR)


def currents(x: np.recarray) -> np.ndarray:
    return np.stack([x.i_a, x.i_b, x.i_c], axis=1)


def command_for(I_ref: float, theta_m: float = 0.0) -> float:
    """Command that asks a motor locked at an angle for a current."""
    return I_ref * ACTUATOR.k_t / (ACTUATOR.GAP * ACTUATOR.G_prop) + theta_m * ACTUATOR.tau


@pytest.mark.parametrize("N", [1.0, 0.6])
def test_locked_rotor_current_rises_as_RL(N):
    """Phases B and C in series; half their difference does not see how A switches."""
    plant = locked(PLANT._replace(motor=PLANT.motor._replace(N_b=N, N_c=N)))
    V, R, L = ACTUATOR.V_max, ACTUATOR.R_s * N, ACTUATOR.L_s * N**2
    duration = 1.2e-4  # in which no phase reaches the current limit
    errors = []
    for dt in (2e-6, 1e-6, 5e-7):
        steps = round(duration / dt)
        x = run(plant, at_rest(), steps, command=1.0, dt=dt)
        rise = (x.i_c - x.i_b) / 2
        n = np.arange(steps + 1)
        # The recursion is solved by a power, so only rounding is left.
        np.testing.assert_allclose(rise, V / R * (1 - (1 - dt * R / L) ** n), atol=1e-11)
        errors.append(np.abs(rise - V / R * (1 - np.exp(-n * dt * R / L))).max())
    # Explicit Euler is off by V/R (t dt / 2 tau^2) exp(-t / tau), at most V/R dt / (2 e tau).
    assert errors[1] < 1.1 * V / R * DT * R / L / (2 * math.e)
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 1.0, atol=0.05)


def largest_rise(i: float) -> float:
    """Most that a phase of the healthy motor at rest can change in a step [A]."""
    v = 4 / 3 * ACTUATOR.V_max / 2 + ACTUATOR.R_s / 2 * i
    return v / (ACTUATOR.L_s / 2) * DT


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0, 15, 45, 75, 100, 200, 301])
@pytest.mark.parametrize("I_ref", [-15.0, 2.0, 12.0])
def test_currents_stay_within_the_double_band(degrees, I_ref):
    """The errors of three phases add up to zero, so one can be as large as the sum of two.

    A leg inside its band does not act, and the star point passes on what the others do: a phase
    can leave its band until another reaches its own edge, at twice the half-band.
    """
    theta = math.radians(degrees) / ACTUATOR.P
    command = command_for(I_ref, theta)
    x = run(locked(PLANT), at_rest(theta, theta), 4000, command=command)
    targets = [I_ref * driven(degrees - 120 * n) for n in range(3)]
    error = np.abs(currents(x)[1500:] - targets)
    assert error.max() <= 2 * ACTUATOR.h_b + largest_rise(16.0)
    # The bound is no formality: the single band is left by far.
    assert error.max() > 1.5 * ACTUATOR.h_b
