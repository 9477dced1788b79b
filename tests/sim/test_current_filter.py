"""The equivalent current and the three lags behind it."""

import math

import numpy as np
import pytest

from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, PlantConstants, constants
from ema_sim.actuator import at_rest
from ema_sim.reference import DT

from .trajectories import locked, run, step

PLANT = constants(ActuatorParameters())
FAULTY = degrade(PLANT, fault_vector({"short_circuit_b": 0.5, "eccentricity": 0.5}))
T = 1e-5  # time constant of each lag [s]


def frozen_current(amperes: float):
    """Plant and state whose current neither rises nor decays: no supply, no resistance."""
    motor = PLANT.motor._replace(V_max=0.0, R_s=0.0)
    state = at_rest()._replace(i_b=-amperes, i_c=amperes)
    return locked(PLANT._replace(motor=motor)), state


@pytest.mark.parametrize("amperes", [4.0, -9.0])
def test_constant_current_comes_through_three_lags(amperes):
    """1 - (1 + t/T + (t/T)^2 / 2) exp(-t/T), with an error of first order in the step."""
    plant, state = frozen_current(amperes)
    errors = []
    for dt in (1e-6, 5e-7, 2.5e-7):
        steps = round(1e-4 / dt)
        x = run(plant, state, steps, dt=dt)
        t = dt / T * np.arange(steps + 1)
        expected = 1 - (1 + t + t**2 / 2) * np.exp(-t)
        errors.append(np.abs(x.lag_3 / amperes - expected).max())
        # One lag alone is exact for what is constant over a step, whatever the step.
        np.testing.assert_allclose(x.lag_1 / amperes, 1 - np.exp(-t), rtol=1e-12)
    # Two of the lags see what the lag before has become in the step: half a step early each, a
    # tenth of T together, times the steepest slope, 2 exp(-2) / T.
    assert errors[0] < 1.2 * DT / T * 2 * math.exp(-2)
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 1.0, atol=0.1)


@pytest.mark.parametrize("plant", [PLANT, FAULTY], ids=["healthy", "faulty"])
def test_equivalent_current_is_the_largest_phase_current_with_the_sign_of_torque(
    plant: PlantConstants,
):
    """Currents that add up to zero: half the sum of their sizes is the largest of them."""
    state = at_rest()
    signs = set()
    for n in range(6000):
        state = step(*plant, state, 4e-3 * math.sin(1200 * n * DT), 0.0, 0.0, DT, 1.0)
        largest = max(abs(state.i_a), abs(state.i_b), abs(state.i_c))
        # A lag that takes up everything in a step hides nothing.
        assert state.lag_3 == pytest.approx(math.copysign(largest, state.torque), abs=1e-11)
        signs.add(math.copysign(1.0, state.torque))
    assert signs == {-1.0, 1.0}
