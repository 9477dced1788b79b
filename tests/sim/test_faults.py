import numpy as np
import pytest

from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_sim.actuator import SimulatedActuator


def test_faults_are_taken_by_name_or_as_a_vector():
    by_name, as_vector = SimulatedActuator(), SimulatedActuator()
    by_name.faults = {"gain": 1.0}
    as_vector.faults = fault_vector({"gain": 1.0})
    np.testing.assert_array_equal(by_name.faults, as_vector.faults)
    command = np.full(50, 1e-4)
    x, y = by_name.advance(command), as_vector.advance(command)
    np.testing.assert_array_equal(x.current, y.current)


@pytest.mark.parametrize("wrong", [np.zeros((2, 8)), np.zeros(7), {"rust": 0.1}, {"gain": 1.1}])
def test_refused_faults_leave_the_actuator_as_it_was(wrong):
    actuator = SimulatedActuator()
    actuator.faults = {"friction": 0.5}
    with pytest.raises(ValueError, match=r"fault"):
        actuator.faults = wrong
    np.testing.assert_array_equal(actuator.faults, fault_vector({"friction": 0.5}))


def test_a_circuit_too_fast_for_the_step_is_refused():
    with pytest.raises(ValueError, match=r"L_s = 1e-06 H with R_s = 2\.13 ohm"):
        SimulatedActuator(ActuatorParameters(L_s=1e-6))
    small = SimulatedActuator(ActuatorParameters(L_s=2e-5))
    with pytest.raises(ValueError, match=r"most shorted phase"):
        small.faults = {"short_circuit_b": 0.99}
