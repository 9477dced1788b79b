"""What the simulated actuator accepts, and what faults do to it."""

import math

import numpy as np
import pytest

from ema_core.faults import fault_vector, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_sim.actuator import SimulatedActuator, at_rest
from ema_sim.effects import Courses, NoEffects
from ema_sim.reference import advance, advance_sample

COMMANDS = 4e-3 * np.sin(np.linspace(0.0, 20.0, 400))


@pytest.mark.parametrize(
    ("faults", "parameters"),
    [
        ({"friction": 0.25}, {"f_sm": 1.5 * 0.06 * 1.689, "f_su": 1.5 * 0.04 * 1.689}),
        ({"backlash": 1.0}, {"BLK": 0.5}),
        ({"gain": 0.25}, {"G_prop": 0.75e5}),
        ({"gain": 1.0}, {"G_prop": 1.5e5}),
    ],
)
def test_fault_equals_a_changed_parameter(faults, parameters):
    faulty = SimulatedActuator()
    faulty.faults = fault_vector(faults)
    changed = SimulatedActuator(ActuatorParameters().replace(parameters))
    x, y = faulty.advance(COMMANDS), changed.advance(COMMANDS)
    # The factors may round apart in the last bit.
    np.testing.assert_allclose(x.position, y.position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(x.current, y.current, rtol=0, atol=1e-9)


def test_faults_take_effect_with_the_next_sample():
    healthy, failing = SimulatedActuator(), SimulatedActuator()
    x = healthy.advance(COMMANDS)
    first = failing.advance(COMMANDS[:200])
    failing.faults = fault_vector({"friction": 0.5})
    second = failing.advance(COMMANDS[200:])
    np.testing.assert_array_equal(first.speed, x.speed[:200])
    assert second.speed[0] != x.speed[200]


def test_healthy_faults_change_nothing():
    untouched, healthy = SimulatedActuator(), SimulatedActuator()
    healthy.faults = healthy_faults()
    x, y = untouched.advance(COMMANDS), healthy.advance(COMMANDS)
    np.testing.assert_array_equal(x.current, y.current)
    assert untouched.state == healthy.state


def test_impossible_faults_leave_the_actuator_as_it_was():
    actuator, untouched = SimulatedActuator(), SimulatedActuator()
    with pytest.raises(ValueError, match="friction"):
        actuator.faults = [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5]
    np.testing.assert_array_equal(actuator.faults, healthy_faults())
    np.testing.assert_array_equal(
        actuator.advance(COMMANDS).current, untouched.advance(COMMANDS).current
    )


def test_load_costs_its_share_of_current():
    """At steady speed k_t I is friction plus load one way, friction less load the other."""
    load, p = 0.1, ActuatorParameters()
    ramp = 2e-5 * np.arange(1, 3001)  # 0.2 rad/s of the user, 100 rad/s of the motor
    means = []
    for direction in (1.0, -1.0):
        actuator = SimulatedActuator()
        actuator.faults = fault_vector({"friction": 1.0})
        block = actuator.advance(direction * ramp, load)
        means.append(block.current[-2000:].mean())
    # The mean of both directions has no friction in it; what ripple adds to the largest of three
    # phase currents has the sign of the torque and goes as well, to 2 %.
    assert sum(means) / 2 == pytest.approx(load / p.k_t, rel=0.02)


@pytest.mark.parametrize("period", [0.0, -1e-4, 1.5e-6, 5e-7, 1.0, math.nan, math.inf])
def test_period_must_be_whole_steps(period):
    with pytest.raises(ValueError, match="sample_period"):
        SimulatedActuator(sample_period=period)


def test_hold_must_divide_the_sample():
    with pytest.raises(ValueError, match=r"noise_hold_s = 3e-05 s does not divide"):
        SimulatedActuator(sample_period=1e-4, noise_hold_s=3e-5)


@pytest.mark.parametrize(
    ("command", "load", "match"),
    [
        ([], 0.0, "command must be a row"),
        ([[0.0]], 0.0, "command must be a row"),
        ([0.0, math.nan], 0.0, "command sample 1 is nan"),
        ([0.0, 1.0], [0.0, math.inf], "load sample 1 is inf"),
        ([0.0, 1.0], math.nan, "load sample 0 is nan"),
        ([0.0, 1.0], [0.0, 1.0, 2.0], "broadcast"),
    ],
)
def test_bad_input_is_refused_and_changes_nothing(command, load, match):
    actuator = SimulatedActuator()
    with pytest.raises(ValueError, match=match):
        actuator.advance(command, load)
    assert actuator.state == at_rest()
    assert actuator.advance([0.0]).first_index == 1


def test_one_version_of_each_kernel_is_compiled():
    """Whole numbers, numpy scalars and lists from outside do not reach the kernels as such.

    There are two versions at most, without and with hidden causes.
    """
    values = {"V_max": 48, "P": np.int64(2), "R_s": np.float32(2.0)}
    actuator = SimulatedActuator(ActuatorParameters().replace(values))
    actuator.faults = np.array([1, 0, 0, 0, 0, 0, 1, 0])
    actuator.advance([0, 1], 0)
    actuator.advance(np.zeros(3, dtype=np.float32), np.ones(3, dtype=np.int64))
    noisy = SimulatedActuator(noise_gain=1, rng=np.random.default_rng(0), noise_hold_s=1e-5)
    noisy.state = at_rest(1, 1)
    noisy.advance((0.0,))
    noisy.causes = {"load_torque": 1, "jam": np.int64(0)}
    noisy.advance([0])
    effects = [signature[3].instance_class for signature in advance.signatures]
    assert sorted(effects, key=str) == sorted((NoEffects, Courses), key=str)
    assert len(advance_sample.signatures) <= 2
