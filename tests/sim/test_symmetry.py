"""What must look the same from another side: mirrored, half a turn on, a phase on.

The switching patterns are chaotic, yet both sides compare the same currents with the same bands,
so that they agree to rounding as long as none of these comparisons is closer than rounding; in the
runs here none is.
"""

import math

import numpy as np
import pytest

from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, PlantConstants, constants
from ema_sim.actuator import at_rest

from .trajectories import run

# Rounding is 1e-13 A and rad/s here; one comparison that falls the other way is 0.04 A.
TOLERANCE = 1e-9
STEPS = 8000
ACTUATOR = ActuatorParameters()
FAULTS = {
    "healthy": {},
    "short_circuit": {"short_circuit_a": 0.1, "short_circuit_b": 0.5},
    "eccentricity": {"eccentricity": 0.5, "eccentricity_phase": 0.8},
    "multiple": {
        "friction": 0.3,
        "backlash": 0.05,
        "short_circuit_b": 0.4,
        "short_circuit_c": 0.1,
        "eccentricity": 0.3,
        "eccentricity_phase": 0.1,
        "gain": 0.3,
    },
}
parametrize_faults = pytest.mark.parametrize("faults", FAULTS.values(), ids=FAULTS.keys())


def command(t: float) -> float:
    return 2e-3 * math.sin(1200 * t)


def load(t: float) -> float:
    return 0.05 * math.sin(500 * t)


def plant_with(faults) -> PlantConstants:
    return degrade(constants(ACTUATOR), fault_vector(faults))


def phase_currents(x: np.recarray) -> dict[str, np.ndarray]:
    return {"a": x.i_a, "b": x.i_b, "c": x.i_c}


def assert_same_motion(x: np.recarray, y: np.recarray, sign: float = 1.0, offset: float = 0.0):
    np.testing.assert_allclose(x.theta_m, sign * (y.theta_m - offset), rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(x.theta_b, sign * (y.theta_b - offset), rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(x.omega, sign * y.omega, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(x.torque, sign * y.torque, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(x.lag_3, sign * y.lag_3, rtol=0, atol=TOLERANCE)
    assert np.abs(x.omega).max() > 20.0


@pytest.mark.slow
@parametrize_faults
def test_mirrored_motion(faults):
    """Turning backwards swaps B and C and the eccentricity's direction; no current changes sign.

    The switching states swap likewise, so all alike at the start, as `at_rest` leaves them, is
    its own mirror image.
    """
    plant = plant_with(faults)
    motor = plant.motor
    mirrored = plant._replace(motor=motor._replace(N_b=motor.N_c, N_c=motor.N_b, phi=-motor.phi))
    x = run(plant, at_rest(), STEPS, command=command, load=load)
    y = run(mirrored, at_rest(), STEPS, command=lambda t: -command(t), load=lambda t: -load(t))
    assert_same_motion(x, y, sign=-1.0)
    np.testing.assert_allclose(x.i_a, y.i_a, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(x.i_b, y.i_c, rtol=0, atol=TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize("P", [1, 2, 3])
@parametrize_faults
def test_phases_are_alike(faults, P):
    """A fault in A is one in B, started a third of an electrical turn on; B in C, C in A.

    The air gaps lie a third of a mechanical turn apart: the eccentricity has to follow by that
    less what the rotor has turned.
    """
    actuator = ACTUATOR.replace({"P": P})
    plant = degrade(constants(actuator), fault_vector(faults))
    motor = plant.motor
    third = 2 * math.pi / 3
    turn = third / P
    moved = plant._replace(
        motor=motor._replace(
            N_b=motor.N_a, N_c=motor.N_b, N_a=motor.N_c, phi=motor.phi - third - turn
        )
    )
    x = run(plant, at_rest(), STEPS, command=command, load=load)
    y = run(
        moved,
        at_rest(turn, turn),
        STEPS,
        command=lambda t: command(t) + turn * actuator.tau,
        load=load,
    )
    assert_same_motion(x, y, offset=turn)
    i, j = phase_currents(x), phase_currents(y)
    for phase, next_phase in ("ab", "bc", "ca"):
        np.testing.assert_allclose(i[phase], j[next_phase], rtol=0, atol=TOLERANCE)
