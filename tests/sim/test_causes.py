"""Hidden causes inside of the actuator: each shows in the telemetry what its equation says."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ema_core.cause_profiles import Causes
from ema_core.causes import CAUSES, COPPER, Place
from ema_core.commands import Command
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import COLUMNS, Telemetry, join
from ema_sim.actuator import SimulatedActuator
from ema_sim.effects import Effects

P = ActuatorParameters()
CHIRP = Command().sample(1e-4)[:2000]


def run(
    causes: Causes,
    command: NDArray[np.float64] = CHIRP,
    parameters: ActuatorParameters = P,
    sample_period: float = 1e-4,
) -> Telemetry:
    actuator = SimulatedActuator(parameters, sample_period=sample_period)
    actuator.causes = causes
    return actuator.advance(command)


def assert_same(one: Telemetry, other: Telemetry) -> None:
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(one, column), getattr(other, column))


def ramp(speed: float, turns: float) -> NDArray[np.float64]:
    """Command that moves the motor at a speed [rad/s] by some turns."""
    steps = round(2 * math.pi * turns / speed / 1e-4)
    return P.tau * speed * 1e-4 * np.arange(1.0, steps + 1)


def wave(telemetry: Telemetry, periods: float) -> complex:
    """Complex amplitude of the current [A] over the motor angle, in whole turns at the end."""
    theta = telemetry.position / P.tau
    turns = math.floor((theta[-1] - theta[0]) / (2 * math.pi)) - 1
    kept = theta > theta[-1] - 2 * math.pi * turns
    current, angle = telemetry.current[kept], theta[kept]
    steps = np.gradient(angle)
    return complex(2 * np.sum(current * np.exp(-1j * periods * angle) * steps) / np.sum(steps))


def test_kernel_has_every_cause_but_those_of_sensors():
    inside = [cause.name for cause in CAUSES if cause.place is not Place.SENSOR]
    assert Effects._fields == ("time", *inside)


@pytest.mark.parametrize(
    "causes",
    [{}, {"current_offset": 1.0}, {name: 0.0 for name in Effects._fields if name != "time"}],
    ids=["none", "of_sensors", "zero"],
)
def test_causes_that_are_absent_change_no_bit(causes):
    """None take the kernels without causes; zeros those with them, whose sums and products with 0
    and 1 are exact."""
    assert_same(run(causes), SimulatedActuator().advance(CHIRP))


def test_times_count_from_the_assignment():
    actuator, other = SimulatedActuator(), SimulatedActuator()
    actuator.advance(CHIRP[:500])
    actuator.causes = ["load_torque=0.1@0.02"]
    other.causes = ["load_torque=0.1@0.07"]
    assert_same(actuator.advance(CHIRP[500:]), join([other.advance(CHIRP)]).part(500, 2000))


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
def test_cause_is_another_plant_under_the_same_control(cause, value, changed):
    assert_same(run({cause: value}), run({}, parameters=replace(P, **changed)))


@pytest.mark.parametrize("dead_time", [5e-6, 1.5e-5])
def test_dead_time_costs_half_of_what_the_current_falls_in_it(dead_time):
    """A blocked motor with two phases, of whose band the current only leaves the lower end."""
    target, R, L = 5.0, P.R_s, P.L_s
    blocked = {"jam": 1.0, "open_phase_a": 1.0}
    command = np.full(1000, target * P.k_t / P.GAP / P.G_prop)
    means = [
        run(blocked | {"dead_time": pause}, command).current[300:].mean()
        for pause in (0.0, dead_time)
    ]
    fall = (P.V_max + R * target) / L * dead_time
    # The band is left in whole steps, in which the current falls by 0.08 A, the mean by half of it.
    assert means[0] - means[1] == pytest.approx(fall / 2, abs=0.04)


def test_cogging_costs_a_current_of_six_waves_a_pole_pair():
    command, A = ramp(20.0, 4), 0.02
    periods = 6 * P.P
    amplitude = wave(run({"cogging": A}, command), periods) - wave(run({}, command), periods)
    # The speed yields a little: 38 Hz against the 318 Hz of the speed loop; the equivalent current
    # holds ripple of the third phase as well.
    assert abs(amplitude) == pytest.approx(A / P.k_t, rel=0.1)


def test_winding_too_hot_for_the_step_is_refused():
    actuator = SimulatedActuator(replace(P, L_s=3e-6))
    with pytest.raises(ValueError, match=r"L_s = 3e-06 H .* most shorted phase"):
        actuator.causes = ["winding_temperature=200@1..2"]
    actuator.causes = {"winding_temperature": 50.0}
