# SPDX-License-Identifier: Apache-2.0
"""The simulated actuator: accepted inputs, and the effects of faults and hidden causes."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ema_core.cause_profiles import Causes
from ema_core.causes import CAUSES, COPPER, SystemPart
from ema_core.commands import THESIS_CHIRP, Command, build_cycle
from ema_core.faults import fault_vector, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry, join
from ema_sim.actuator import SimulatedActuator, at_rest
from ema_sim.effects import Courses, Effects, NoEffects
from ema_sim.reference import advance, advance_sample

from .trajectories import assert_same

COMMANDS = 4e-3 * np.sin(np.linspace(0.0, 20.0, 400))


def test_faults_take_effect_with_the_next_sample():
    healthy, failing = SimulatedActuator(), SimulatedActuator()
    x = healthy.advance(COMMANDS)
    first = failing.advance(COMMANDS[:200])
    failing.faults = fault_vector({"friction": 0.5})
    second = failing.advance(COMMANDS[200:])
    np.testing.assert_array_equal(first.speed, x.speed[:200])
    assert second.speed[0] != x.speed[200]


def test_impossible_faults_leave_the_actuator_unchanged():
    actuator, untouched = SimulatedActuator(), SimulatedActuator()
    with pytest.raises(ValueError, match="friction"):
        actuator.faults = [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5]
    np.testing.assert_array_equal(actuator.faults, healthy_faults())
    np.testing.assert_array_equal(
        actuator.advance(COMMANDS).current, untouched.advance(COMMANDS).current
    )


@pytest.mark.parametrize("k", [0.0, 0.3, 1.0])
def test_approach_leaves_the_gear_on_one_flank(k):
    """For any initial position of the motor in its play, the test cycle starts pushing forwards."""
    cycle = build_cycle(THESIS_CHIRP, 1e-4)
    half = 2.5e-3 * (1 + 99 * k)
    for offset in (-1.0, 0.0, 1.0):
        actuator = SimulatedActuator()
        actuator.faults = fault_vector({"backlash": k})
        actuator.state = at_rest(0.0, offset * half)
        telemetry = actuator.advance(cycle.samples[: cycle.start + 1])
        # The actuator is at rest throughout the hold before the command.
        assert (telemetry.speed[-500:] == 0.0).all()
        x = actuator.state
        assert x.theta_m - x.theta_b == pytest.approx(half, rel=1e-12)


@pytest.mark.parametrize("period", [0.0, -1e-4, 1.5e-6, 5e-7, 1.0, math.nan, math.inf])
def test_sample_period_must_be_a_whole_number_of_steps(period):
    with pytest.raises(ValueError, match="sample_period"):
        SimulatedActuator(sample_period=period)


def test_noise_hold_must_divide_the_sample_period():
    with pytest.raises(ValueError, match=r"noise_hold_s = 3e-05 s does not divide"):
        SimulatedActuator(sample_period=1e-4, noise_hold_s=3e-5)


@pytest.mark.parametrize(
    ("command", "load", "match"),
    [
        ([], 0.0, "command must be a non-empty one-dimensional array"),
        ([[0.0]], 0.0, "command must be a non-empty one-dimensional array"),
        ([0.0, math.nan], 0.0, "command sample 1 is nan"),
        ([0.0, 1.0], [0.0, math.inf], "load sample 1 is inf"),
        ([0.0, 1.0], math.nan, "load sample 0 is nan"),
        ([0.0, 1.0], [0.0, 1.0, 2.0], "broadcast"),
    ],
)
def test_invalid_input_is_refused_and_changes_nothing(command, load, match):
    actuator = SimulatedActuator()
    with pytest.raises(ValueError, match=match):
        actuator.advance(command, load)
    assert actuator.state == at_rest()
    assert actuator.advance([0.0]).first_index == 1


def test_only_one_version_of_each_kernel_is_compiled():
    """Integers, numpy scalars and lists from a caller are converted before the kernels.

    There are at most two versions, without and with hidden causes.
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


P = ActuatorParameters()
CHIRP = Command().sample(1e-4)[:2000]


def run(causes: Causes, parameters: ActuatorParameters = P) -> Telemetry:
    actuator = SimulatedActuator(parameters)
    actuator.causes = causes
    return actuator.advance(CHIRP)


def test_kernel_has_every_cause_except_those_of_sensors():
    inside = [cause.name for cause in CAUSES if cause.place is not SystemPart.SENSOR]
    assert Effects._fields == ("time", *inside)


@pytest.mark.parametrize(
    "causes",
    [{}, {"current_offset": 1.0}, {name: 0.0 for name in Effects._fields if name != "time"}],
    ids=["none", "of_sensors", "zero"],
)
def test_absent_causes_leave_results_bit_identical(causes):
    """Without causes, the kernels without causes run.

    With zeros, the kernels with causes run, in which sums with 0 and products with 1 are exact.
    """
    assert_same(run(causes), SimulatedActuator().advance(CHIRP))


def test_times_of_causes_count_from_the_assignment():
    actuator, late = SimulatedActuator(), SimulatedActuator()
    actuator.advance(CHIRP[:500])
    actuator.causes = ["load_torque=0.1@0.02"]
    late.causes = ["load_torque=0.1@0.07"]
    assert_same(actuator.advance(CHIRP[500:]), join([late.advance(CHIRP)]).part(500, 2000))


@pytest.mark.parametrize(
    ("cause", "value", "changed"),
    [
        ("torque_constant", -0.1, {"k_e": P.k_e * (1.0 - 0.1)}),
        ("winding_temperature", 80.0, {"R_s": P.R_s * (1.0 + COPPER * 80.0)}),
        ("supply_voltage", -0.2, {"V_max": P.V_max * (1.0 - 0.2)}),
        ("viscous_friction", 40.0, {"C_m": (P.C_m + P.C_u) * 41.0, "C_u": 0.0}),
        ("inertia", 0.25, {"J_m": (P.J_m + P.J_u) * 1.25, "J_u": 0.0}),
    ],
)
def test_cause_equals_a_changed_plant_under_the_same_control(cause, value, changed):
    assert_same(run({cause: value}), run({}, parameters=replace(P, **changed)))


def test_winding_too_hot_for_the_step_is_refused():
    actuator = SimulatedActuator(replace(P, L_s=3e-6))
    with pytest.raises(ValueError, match=r"L_s = 3e-06 H .* most shorted phase"):
        actuator.causes = ["winding_temperature=200@1..2"]
    actuator.causes = {"winding_temperature": 50.0}
