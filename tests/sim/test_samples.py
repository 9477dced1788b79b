"""Telemetry: what a sample is, and that blocks do not show in it."""

import numpy as np
import pytest

from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_sim.actuator import SimulatedActuator

FAULTS = fault_vector({"short_circuit_b": 0.3, "backlash": 0.02, "eccentricity": 0.2})
RNG = np.random.default_rng(5)
N = 60
COMMANDS = 3e-3 * np.sin(np.linspace(0.0, 12.0, N)) + 1e-4 * RNG.standard_normal(N)
LOADS = 0.05 * RNG.standard_normal(N)


def noisy_actuator(**settings) -> SimulatedActuator:
    actuator = SimulatedActuator(
        noise_gain=2.0, noise_hold_s=5e-6, rng=np.random.default_rng(17), **settings
    )
    actuator.faults = FAULTS
    return actuator


def in_blocks(actuator: SimulatedActuator, lengths: list[int]) -> list[Telemetry]:
    blocks, start = [], 0
    for length in lengths:
        stop = start + length
        blocks.append(actuator.advance(COMMANDS[start:stop], LOADS[start:stop]))
        start = stop
    assert start == N
    return blocks


@pytest.mark.parametrize(
    "lengths", [[1] * N, [7, 1, 30, 2, 20], [59, 1]], ids=["ones", "uneven", "two"]
)
def test_blocks_do_not_show(lengths):
    """Bit by bit, with noise, load and faults: all that lives between samples is in the state."""
    actuator, whole_actuator = noisy_actuator(), noisy_actuator()
    blocks = in_blocks(actuator, lengths)
    (whole,) = in_blocks(whole_actuator, [N])
    for column in ("command", "current", "position", "speed"):
        joined = np.concatenate([getattr(block, column) for block in blocks])
        np.testing.assert_array_equal(joined, getattr(whole, column))
    stamps = np.concatenate([block.stamps_ns for block in blocks])
    np.testing.assert_array_equal(stamps, whole.stamps_ns)
    assert actuator.state == whole_actuator.state


def test_current_is_the_mean_over_a_sample_the_rest_its_end():
    """Against the same actuator sampled at every step."""
    steps = 50
    coarse = SimulatedActuator(sample_period=steps * 1e-6)
    fine = SimulatedActuator(sample_period=1e-6)
    coarse.faults = fine.faults = FAULTS
    x = coarse.advance(COMMANDS, LOADS)
    # The command at the end of every step, on straight lines between the samples. A step uses
    # the value at its start, which for the fine actuator is the end of the sample before.
    share = np.arange(1, steps + 1) / steps

    def straight(values: np.ndarray) -> np.ndarray:
        before = np.concatenate([[0.0], values[:-1]])[:, np.newaxis]
        rows = before + share * (values[:, np.newaxis] - before)
        rows[:, -1] = values
        return rows.ravel()

    y = fine.advance(straight(COMMANDS), straight(LOADS))
    mean = y.current.reshape(N, steps).mean(axis=1)
    # Only rounding differs: in the sums, and where a sector or the gap is looked up.
    np.testing.assert_allclose(x.current, mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(x.position, y.position[steps - 1 :: steps], rtol=0, atol=1e-15)
    np.testing.assert_allclose(x.speed, y.speed[steps - 1 :: steps], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(x.command, COMMANDS)
    assert np.ptp(y.current.reshape(N, steps), axis=1).max() > 0.1
    np.testing.assert_array_equal(x.stamps_ns, y.stamps_ns[steps - 1 :: steps])


def test_command_and_load_run_straight_from_sample_to_sample():
    """A step takes the value at its start: the last of a sample is one step short of its end."""
    actuator = SimulatedActuator()
    last = 0.0
    for value in (1e-5, 3e-5, -2e-5):  # too little to move it
        actuator.advance([value])
        taken = actuator.state.error / actuator.parameters.G_prop
        assert taken == pytest.approx(last + 0.99 * (value - last), rel=1e-12)
        last = value
    # A load that rises to 1 % above what holds the shaft frees it in the last step of 100.
    holding = SimulatedActuator(ActuatorParameters(k_e=1e-6))
    holding.advance([0.0], 0.1689 * (1 + 1e-4) / 0.99)
    torque = -0.1689 * (1 + 1e-4) + 0.1689 / 2
    assert holding.state.omega == pytest.approx(torque / 2.5e-5 * 1e-6, rel=1e-9)
