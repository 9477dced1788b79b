"""Where the electrical energy goes."""

from typing import NamedTuple

import numpy as np
import pytest

from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, PlantConstants, constants
from ema_sim.actuator import at_rest

from .trajectories import run

PLANT = constants(ActuatorParameters())
FAULTS = {
    "healthy": {},
    "multiple": {
        "friction": 0.5,
        "short_circuit_b": 0.4,
        "eccentricity": 0.5,
        "eccentricity_phase": 0.3,
    },
}
LOAD = 0.1


class Energies(NamedTuple):
    """Energies of a run [J]."""

    electrical: float
    copper: float
    magnetic: float
    kinetic: float
    friction: float
    viscous: float
    load: float

    @property
    def residue(self) -> float:
        return self.electrical - sum(self[1:])


def energies(plant: PlantConstants, duration: float, dt: float) -> Energies:
    """Run from rest at full power, integrated by the mid-point rule."""
    x = run(plant, at_rest(), round(duration / dt), command=1.0, load=LOAD, dt=dt)
    motor, mech = plant.motor, plant.mechanics
    N = np.array([motor.N_a, motor.N_b, motor.N_c])
    i = np.stack([x.i_a, x.i_b, x.i_c], axis=1)
    q = np.stack([x.q_a, x.q_b, x.q_c], axis=1)[1:]
    i_mid = (i[1:] + i[:-1]) / 2
    omega_mid = (x.omega[1:] + x.omega[:-1]) / 2
    assert x.torque.max() < motor.T_max
    return Energies(
        electrical=float(np.sum(motor.V_max / 2 * q * i_mid) * dt),
        copper=float(np.sum(motor.R_s / 2 * N * i_mid**2) * dt),
        magnetic=float(np.sum(motor.L_s / 4 * N**2 * (i[-1] ** 2 - i[0] ** 2))),
        kinetic=float(mech.J / 2 * (x.omega[-1] ** 2 - x.omega[0] ** 2)),
        friction=float(np.sum(mech.f_d * np.abs(omega_mid)) * dt),
        viscous=float(np.sum(mech.C * omega_mid**2) * dt),
        load=float(np.sum(LOAD * omega_mid) * dt),
    )


@pytest.mark.parametrize("name", FAULTS)
def test_energy_is_conserved(name):
    """Electrical in = copper + magnetic + kinetic + friction + viscous + load.

    The star point does no work. Losses come to the same in every step, while what the motor
    converts is off by its change within a step: an error of first order in the step.
    """
    plant = degrade(PLANT, fault_vector(FAULTS[name]))
    steps = (2e-6, 1e-6, 5e-7)
    runs = [energies(plant, 3e-3, dt) for dt in steps]
    for run_ in runs:
        assert min(run_) > 0.0
    relative = np.array([abs(run_.residue) / run_.electrical for run_ in runs])
    assert relative[1] < 1.5e-4
    # Switching differs from step to step size, so the order is not met to the digit.
    np.testing.assert_allclose(np.log2(relative[:-1] / relative[1:]), 1.0, atol=0.2)
