# SPDX-License-Identifier: Apache-2.0
"""The kernels and the plain-Python twin give the same results, with and without hidden causes."""

import math

import numpy as np
import pytest

from ema_core.dynamics import lag_factor
from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, constants
from ema_core.telemetry import join
from ema_sim.actuator import SimulatedActuator, at_rest
from ema_sim.effects import NO_EFFECTS, NO_PAUSES
from ema_sim.motor import GAP_REACH, sector_at, windings
from ema_sim.reference import DT, State, Stepping, advance_sample

from .reference_twin import MULTIPLE, ReferenceTwin
from .trajectories import MEAN, run

# Both round by about 1e-13 A and N.m, and differences mostly decay. However, as soon as a
# comparison of a current with its band differs, a phase moves by 0.04 A and the switching patterns
# separate for good. This does not occur in these short runs, but would in a long one.
TOLERANCE = 1e-9
STEPS = 6000


def at_end_stop(twin: ReferenceTwin) -> bool:
    return abs(twin.theta_m) == twin.actuator.theta_stop / twin.actuator.tau


def at_torque_limit(twin: ReferenceTwin) -> bool:
    return abs(twin.torque) == twin.actuator.T_max


def moves_inside_its_play(twin: ReferenceTwin) -> bool:
    return twin.omega != 0.0 and abs(twin.theta_m - twin.theta_out) < 0.499 * twin.play


def sticks(twin: ReferenceTwin) -> bool:
    return twin.omega == 0.0 and twin.torque != 0.0


# Parameters, faults, and an event that must occur in at least 20 steps to make the case meaningful.
CASES = {
    "healthy": ({}, {}, sticks),
    "short_circuits": (
        {},
        {"short_circuit_a": 0.2, "short_circuit_b": 0.7, "short_circuit_c": 0.05},
        sticks,
    ),
    "worst_short_circuit": ({}, {"short_circuit_c": 0.99}, sticks),
    "eccentricity": ({}, {"eccentricity": 0.6, "eccentricity_phase": 0.83}, sticks),
    "friction": ({}, {"friction": 0.75}, sticks),
    "backlash": ({}, {"backlash": 0.01}, moves_inside_its_play),
    "gain_low": ({}, {"gain": 0.1}, sticks),
    "gain_high": ({}, {"gain": 1.0}, sticks),
    "multiple": ({}, MULTIPLE, moves_inside_its_play),
    "pid": ({"GAI": 0.5, "GAD": 1e-6}, MULTIPLE, moves_inside_its_play),
    "end_stop": ({"theta_stop": 1e-3, "tau": 0.1}, {}, at_end_stop),
    "limits": ({"T_max": 0.5, "I_max": 9.0, "omega_max": 60.0}, {}, at_torque_limit),
    "another_motor": (
        {"P": 5, "J_m": 4e-5, "R_s": 0.8, "h_b": 0.2, "f_ratio": 0.8},
        MULTIPLE,
        moves_inside_its_play,
    ),
}


def command(t: float) -> float:
    """Return the command: small at first without saturation, then large enough to saturate all."""
    amplitude = 1.5e-4 if t < 2.5e-3 else 0.02
    return amplitude * math.sin(2 * math.pi * 300 * t)


def load(t: float) -> float:
    return 0.06 * math.sin(1500 * t)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_kernel_step_equals_twin(case):
    values, faults, happens = CASES[case]
    actuator = ActuatorParameters().replace(values)
    plant = degrade(constants(actuator), fault_vector(faults))
    noise = np.random.default_rng(7).normal(0.0, 0.5, STEPS)
    states = run(plant, at_rest(), STEPS, command=command, load=load, noise=noise)
    twin, expected, seen = ReferenceTwin(actuator, faults), [], 0
    for n in range(STEPS):
        t = n * DT
        twin.step(command(t), noise[n], load(t))
        seen += happens(twin)
        angles = twin.theta_m, twin.omega, twin.theta_out
        loops = twin.integral, twin.last_error, twin.torque
        expected.append((*angles, *twin.i, *twin.q, *twin.lag, *loops))
    np.testing.assert_allclose(states[1:].tolist(), expected, rtol=0, atol=TOLERANCE)
    assert seen >= 20


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_sample_equals_its_single_steps(case):
    """Commutation, switching, gap and end stop persist over the steps of a sample."""
    values, faults, _ = CASES[case]
    plant = degrade(constants(ActuatorParameters().replace(values)), fault_vector(faults))
    phases, lag, long = windings(plant.motor), lag_factor(DT), 2000
    x = y = at_rest()._replace(omega=300.0)
    noise = np.random.default_rng(7).normal(0.0, 0.5, STEPS // 10)
    theta, step = [], np.arange(long)
    for first in range(0, STEPS, long):
        knots = 0.8e-3 * (first / STEPS), 0.8e-3 * ((first + long) / STEPS)
        rise = (knots[1] - knots[0]) / long
        rest = noise, first, Stepping(long, 10, DT, lag, MEAN), 0.0
        plain = NO_EFFECTS, NO_PAUSES
        y, total, _ = advance_sample(*plant, phases, *plain, y, knots[0], rise, 0.02, 1e-5, *rest)
        states = run(
            plant,
            x,
            long,
            command=knots[0] + step * rise,
            load=0.02 + step * 1e-5,
            noise=noise[(first + step) // 10],
        )
        x = State(*states[-1].tolist())
        theta += states.theta_m[1:].tolist()
        assert total == pytest.approx(states.lag_3[1:].sum(), rel=TOLERANCE)
        np.testing.assert_allclose(y, x, rtol=0, atol=TOLERANCE)
    # Within samples, the position in the gap changes several times, and the commutation at least
    # once.
    assert np.ptp(theta[:long]) > 3 * GAP_REACH
    middles = [sector_at(plant.motor, plant.mechanics, angle).middle for angle in theta]
    changes = np.flatnonzero(np.diff(middles)) + 1
    assert case == "end_stop" or np.any(changes % long)


PERIOD, STEPS_A_SAMPLE, SAMPLES, BEGIN = 5e-5, 50, 120, 30
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
CAUSES = {
    "none": {},
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
@pytest.mark.parametrize("case", CAUSES)
def test_telemetry_equals_twin(case):
    """This includes the code between kernel and telemetry: interpolation, noise, means and scales.

    Hidden causes begin while currents flow.
    """
    t = PERIOD * np.arange(1, SAMPLES + 1)
    commands, loads = 4e-3 * np.sin(600 * t), 0.06 * np.sin(1500 * t)
    kernel = SimulatedActuator(sample_period=PERIOD, noise_gain=0.2, rng=np.random.default_rng(11))
    kernel.faults = fault_vector(MULTIPLE)
    before = kernel.advance(commands[:BEGIN], loads[:BEGIN])
    kernel.causes = CAUSES[case]
    telemetry = join([before, kernel.advance(commands[BEGIN:], loads[BEGIN:])])

    twin = ReferenceTwin(ActuatorParameters(), MULTIPLE)
    rng = np.random.default_rng(11)
    knots = PERIOD * np.arange(SAMPLES + 1)
    expected, interrupted = [], 0
    for k in range(SAMPLES):
        if k == BEGIN:
            assert max(abs(i) for i in twin.i) > 1.0
            twin.cause |= CAUSES[case]
        total = 0.0
        for j in range(STEPS_A_SAMPLE):
            at = knots[k] + j * DT
            twin.step(
                float(np.interp(at, knots, [0.0, *commands])),
                math.sqrt(0.2) * rng.standard_normal(),
                float(np.interp(at, knots, [0.0, *loads])),
            )
            total += twin.lag[2]
            interrupted += max(twin.dead) > 0.0
        expected.append((total / STEPS_A_SAMPLE, twin.theta_user, twin.omega))
    columns = np.column_stack([telemetry.current, telemetry.position, telemetry.speed])
    np.testing.assert_allclose(columns, expected, rtol=0, atol=TOLERANCE)
    assert "dead_time" not in CAUSES[case] or interrupted >= 20
