"""The play between motor and output."""

import pytest

from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.faults import fault_vector
from ema_sim.actuator import SimulatedActuator, at_rest


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
