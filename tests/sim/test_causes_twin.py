"""The kernels with hidden causes and the plain-Python twin are the same actuator."""

import numpy as np
import pytest

from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_sim.actuator import SimulatedActuator

from .reference_twin import ReferenceTwin
from .test_twin import MULTIPLE, TOLERANCE

PERIOD, STEPS, SAMPLES = 5e-5, 50, 120
FAST = 4e-3 * np.sin(600 * PERIOD * np.arange(1, SAMPLES + 1))
PLANT = {
    "load_torque": 0.03,
    "load_stiffness": 5.0,
    "torque_constant": -0.1,
    "winding_temperature": 80.0,
    "supply_voltage": -0.2,
    "viscous_friction": 200.0,
    "inertia": 0.25,
    "cogging": 0.03,
    "stribeck": 1.5,
    "friction_ripple": 0.4,
    "supply_ripple": 0.1,
}
CASES = {
    **{name: {name: value} for name, value in PLANT.items()},
    "plant": PLANT,
    "dead_time": {"dead_time": 3e-6},
    "fraction_of_a_step": {"dead_time": 2.5e-6},
    "long_dead_time": {"dead_time": 2e-5},
    "open_phase_a": {"open_phase_a": 1.0},
    "open_phase_b": {"open_phase_b": 1.0},
    "open_phase_c": {"open_phase_c": 1.0},
    "two_open_phases": {"open_phase_a": 1.0, "open_phase_c": 1.0},
    "dead_switch": {"dead_switch": 1.0},
    "jam": {"jam": 1.0},
    "all": PLANT | {"dead_time": 4.25e-6, "dead_switch": 1.0},
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_telemetry_with_causes_equals_twin(case):
    """They begin while currents flow. To what both round differently, as in `test_twin`."""
    begin = 30 * PERIOD
    kernel = SimulatedActuator(sample_period=PERIOD)
    kernel.faults = fault_vector(MULTIPLE)
    kernel.advance(FAST[:30])
    kernel.causes = CASES[case]
    telemetry = kernel.advance(FAST[30:])

    twin = ReferenceTwin(ActuatorParameters(), MULTIPLE)
    with_causes = ReferenceTwin(ActuatorParameters(), MULTIPLE, causes=CASES[case])
    knots = PERIOD * np.arange(SAMPLES + 1)
    interrupted = 0
    for k in range(SAMPLES):
        if k == 30:
            assert max(abs(i) for i in twin.i) > 1.0
            for name in ("theta_m", "omega", "theta_out", "i", "q", "lag", "integral"):
                setattr(with_causes, name, getattr(twin, name))
            with_causes.last_error, with_causes.time = twin.last_error, begin
            twin = with_causes
        total = 0.0
        for j in range(STEPS):
            twin.step(float(np.interp(knots[k] + j * 1e-6, knots, [0.0, *FAST])))
            total += twin.lag[2]
            interrupted += max(twin.dead) > 0.0
        if k >= 30:
            assert telemetry.current[k - 30] == pytest.approx(total / STEPS, abs=TOLERANCE)
            assert telemetry.position[k - 30] == pytest.approx(twin.theta_user, abs=TOLERANCE)
            assert telemetry.speed[k - 30] == pytest.approx(twin.omega, abs=TOLERANCE)
    assert "dead_time" not in CASES[case] or interrupted >= 20
