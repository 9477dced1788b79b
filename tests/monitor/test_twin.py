"""Both forms of the monitor model and their plain-Python twin are the same model."""

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, fault_vector, random_faults
from ema_core.parameters import ActuatorParameters
from ema_core.simd import LANES
from ema_monitor.model.deviations import NAMES, Deviations
from ema_monitor.model.drives import IDLE_CONTRAST
from ema_monitor.model.monitor_model import MonitorModel

from .monitor_twin import MonitorTwin
from .windows import window_from

# Both round differently, by some 1e-13 A and 1e-11 rad/s. A comparison that falls the other way,
# between current and reference in the source form or at the edge of a driven pair, takes a
# coincidence to that precision and would move a sample by at least 1e-4 A.
TOLERANCE = 1e-9
SPEED_TOLERANCE = 1e-7
LIFT = {"fast": {"lift": 0.3}, "source": {}}
STEPS = 5000

MULTIPLE = {
    "friction": 0.3,
    "backlash": 0.02,
    "short_circuit_a": 0.1,
    "short_circuit_b": 0.25,
    "eccentricity": 0.4,
    "eccentricity_phase": 0.1,
    "gain": 0.8,
}


def sticks(twin: MonitorTwin) -> bool:
    return twin.omega == 0.0 and twin.torque != 0.0


def brakes(twin: MonitorTwin) -> bool:
    return twin.omega * twin.torque < 0.0


def moves_inside_its_play(twin: MonitorTwin) -> bool:
    return twin.omega != 0.0 and abs(twin.theta_m - twin.theta_out) < 0.499 * twin.play


def at_end_stop(twin: MonitorTwin) -> bool:
    return abs(twin.theta_m) == twin.actuator.theta_stop / twin.actuator.tau


def at_torque_limit(twin: MonitorTwin) -> bool:
    return abs(twin.torque) == twin.actuator.T_max


# Parameters, faults, state at the start, and what must happen for the case to mean something.
CASES = {
    "healthy": ({}, {}, {}, sticks),
    "short_circuits": (
        {},
        {"short_circuit_a": 0.2, "short_circuit_b": 0.7, "short_circuit_c": 0.05},
        {},
        sticks,
    ),
    "worst_short_circuit": ({}, {"short_circuit_c": 0.99}, {}, sticks),
    "eccentricity": ({}, {"eccentricity": 0.6, "eccentricity_phase": 0.83}, {}, sticks),
    "friction": ({}, {"friction": 0.75}, {}, sticks),
    "backlash_lower_flank": ({}, {"backlash": 0.02}, {"play": -1.0}, moves_inside_its_play),
    "backlash_upper_flank": ({}, {"backlash": 0.02}, {"play": 1.0}, moves_inside_its_play),
    "gain_low": ({}, {"gain": 0.1}, {}, sticks),
    "gain_high": ({}, {"gain": 1.0}, {}, sticks),
    "multiple": ({}, MULTIPLE, {"play": 0.3}, moves_inside_its_play),
    "in_motion": (
        {},
        {"short_circuit_b": 0.4},
        {"position": 3e-4, "speed": -90.0, "current": 3.0},
        brakes,
    ),
    "pid": (
        {"GAI": 0.5, "GAD": 1e-7},
        MULTIPLE,
        {"position": 1e-4, "speed": 20.0, "current": -1.5, "play": -0.4},
        moves_inside_its_play,
    ),
    "pd": ({"GAD": 1e-7}, MULTIPLE, {"speed": 20.0}, moves_inside_its_play),
    "end_stop": (
        {"theta_stop": 1e-3, "tau": 0.1},
        {"eccentricity": 0.5, "eccentricity_phase": 0.3},
        {},
        at_end_stop,
    ),
    "limits": ({"T_max": 0.5, "I_max": 9.0, "omega_max": 60.0}, {}, {}, at_torque_limit),
    "another_motor": (
        {"P": 5, "J_m": 4e-5, "R_s": 0.8, "h_b": 0.2, "f_ratio": 0.8},
        MULTIPLE,
        {},
        moves_inside_its_play,
    ),
}
UNIT = {
    "load_torque": 0.02,
    "load_stiffness": 0.4,
    "torque_constant": -0.06,
    "winding_temperature": 60.0,
    "supply_voltage": -0.1,
    "viscous_friction": 2.0,
    "inertia": 0.15,
    "friction": -0.1,
    "stribeck_speed": 4.0,
    "loop_delay": 3e-5,
    "backlash": 0.7,
    "loop_gain": 0.05,
    "speed_loop": -0.04,
    "turns_a": -0.02,
    "turns_b": 0.03,
    "turns_c": 0.01,
    "eccentricity_cos": 0.03,
    "eccentricity_sin": -0.05,
    "current_offset": 0.1,
    "current_gain": -0.03,
    "speed_offset": -0.5,
    "speed_gain": 0.02,
    "current_delay": 2e-4,
    "speed_delay": 5e-5,
}
# Deviations, and faults beside them.
DEVIATIONS = {
    "load_torque": ({"load_torque": 0.03}, {}),
    "load_stiffness": ({"load_stiffness": -2.0}, {"backlash": 0.02}),
    "stribeck": ({"stribeck_speed": 5.0}, {"friction": 0.2}),
    "loop_delay": ({"loop_delay": 4e-5}, {"short_circuit_a": 0.3}),
    "eccentricity": (
        {"eccentricity_cos": -0.1, "eccentricity_sin": 0.2},
        {"eccentricity": 0.3, "eccentricity_phase": 0.7},
    ),
    "turns": ({"turns_b": -0.1}, {"short_circuit_b": 0.3}),
    "all": (UNIT, {}),
    "all_and_faults": (UNIT, MULTIPLE),
}
# The fast form's 100 ms hold a growing oscillation, the source form's 5 ms one that is as fast.
FORMS = {"fast": (2e-5, 1e-4, 30.0), "source": (1e-6, 5e-5, 400.0)}


def twin_of(actuator, faults, form, deviations=None, **start):
    dt = FORMS[form][0]
    return MonitorTwin(
        actuator,
        faults,
        form=form,
        dt=dt,
        contrast=IDLE_CONTRAST,
        deviations=LIFT[form] | (deviations or {}),
        **start,
    )


def unit(form, deviations=None) -> Deviations:
    return Deviations(**LIFT[form] | (deviations or {}))


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("case", CASES)
def test_kernel_equals_twin(case, form):
    values, faults, start, happens = CASES[case]
    dt, period, frequency = FORMS[form]
    steps = round(period / dt)
    t = period * np.arange(STEPS // steps + 1)
    # Small at first, so that nothing is saturated, then large enough to saturate everything.
    amplitude = np.where(t < 0.4 * t[-1], 1.5e-4, 0.02)
    command = start.get("position", 0.0) + amplitude * np.sin(2 * np.pi * frequency * t)
    actuator = ActuatorParameters().replace(values)
    twin = twin_of(actuator, faults, form, command=float(command[0]), **start)

    seen = []
    current, speed = twin.samples(command.tolist(), steps, lambda twin: seen.append(happens(twin)))
    window = window_from(command, sample_period=period, **start)
    model = MonitorModel(actuator, form, dt, unit(form))
    response = model.respond(window, fault_vector(faults), start.get("play", 0.0))
    assert response.current.shape == response.speed.shape == (1, len(t) - 1)
    assert response.current[0] == pytest.approx(current, abs=TOLERANCE, rel=0)
    assert response.speed[0] == pytest.approx(speed, abs=SPEED_TOLERANCE, rel=0)
    assert sum(seen) >= 20


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("case", DEVIATIONS)
def test_unit_that_deviates_equals_its_twin(case, form):
    """Whether the unit is said to deviate or an individual of it."""
    deviations, faults = DEVIATIONS[case]
    dt, period, frequency = FORMS[form]
    steps = round(period / dt)
    t = period * np.arange(2000 // steps + 1)
    command = np.where(t < 0.4 * t[-1], 1.5e-4, 0.02) * np.sin(2 * np.pi * frequency * t)
    actuator = ActuatorParameters()
    twin = twin_of(actuator, faults, form, deviations, play=0.3)
    current, speed = twin.samples(command.tolist(), steps, lambda twin: None)
    window = window_from(command, sample_period=period)
    k = fault_vector(faults)
    whole = MonitorModel(actuator, form, dt, unit(form, deviations)).respond(window, k, 0.3)
    row = np.array([[deviations.get(name, 0.0) for name in NAMES]])
    individual = MonitorModel(actuator, form, dt, unit(form)).respond(
        window, k, 0.3, deviations=row
    )
    for response in (whole, individual):
        assert response.current[0] == pytest.approx(current, abs=TOLERANCE, rel=0)
        assert response.speed[0] == pytest.approx(speed, abs=SPEED_TOLERANCE, rel=0)


def test_stiffness_and_stribeck_friction_hold_and_slip():
    """So that their twins mean something: both stop and let go."""
    dt, period, frequency = FORMS["fast"]
    steps = round(period / dt)
    t = period * np.arange(5000 // steps + 1)
    command = 1.5e-4 * np.sin(2 * np.pi * frequency * t)
    for deviations in ({"stribeck_speed": 5.0}, {"load_stiffness": 5.0}):
        twin = twin_of(ActuatorParameters(), {}, "fast", deviations)
        held, _ = seen = [], []
        twin.samples(
            command.tolist(), steps, lambda twin, seen=seen: seen[not sticks(twin)].append(True)
        )
        assert min(len(one) for one in seen) > 20, (deviations, len(held))


@pytest.mark.parametrize("form", FORMS)
def test_every_lane_equals_its_twin(form):
    dt, period, frequency = FORMS[form]
    rng, n = np.random.default_rng(8), LANES + 2
    faults = np.stack([random_faults(rng) for _ in range(n)])
    play = rng.uniform(-1.0, 1.0, n)
    t = period * np.arange(round(1000 * dt / period) + 1)
    command = 0.02 * np.sin(2 * np.pi * frequency * t)
    actuator = ActuatorParameters()
    window = window_from(command, sample_period=period)
    response = MonitorModel(actuator, form, dt, unit(form)).respond(window, faults, play)
    for i in range(n):
        named = dict(zip(FAULT_NAMES, faults[i].tolist(), strict=True))
        twin = twin_of(actuator, named, form, play=float(play[i]))
        current, speed = twin.samples(command.tolist(), round(period / dt), lambda twin: None)
        assert response.current[i] == pytest.approx(current, abs=TOLERANCE, rel=0)
        assert response.speed[i] == pytest.approx(speed, abs=SPEED_TOLERANCE, rel=0)
