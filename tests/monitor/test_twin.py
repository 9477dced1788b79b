# SPDX-License-Identifier: Apache-2.0
"""Both forms of the monitor model equal their plain-Python twin."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import pytest

from ema_core.faults import fault_vector
from ema_core.parameters import ActuatorParameters
from ema_monitor.model.deviations import NAMES, Deviations
from ema_monitor.model.drives import IDLE_CONTRAST
from ema_monitor.model.monitor_model import MonitorModel

from ..sim.reference_twin import MULTIPLE
from .monitor_twin import MonitorTwin
from .windows import window_from

# Both round by about 1e-13 A and 1e-11 rad/s; a comparison with a different result changes 1e-4 A.
TOLERANCE = 1e-9
SPEED_TOLERANCE = 1e-7
LIFT = {"fast": {"lift": 0.3}, "source": {}}
STEPS = 5000


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


class Case(NamedTuple):
    """Faults, deviations, an event that must occur in a valid case, start and parameters."""

    faults: Mapping[str, float] = {}
    deviations: Mapping[str, float] = {}
    happens: Callable[[MonitorTwin], bool] = sticks
    start: Mapping[str, float] = {}
    parameters: Mapping[str, float] = {}


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
PLAY = {"backlash": 0.02}
CASES = {
    "healthy": Case(),
    "worst_short_circuit": Case({"short_circuit_c": 0.99}),
    "lower_flank": Case(PLAY, {}, moves_inside_its_play, {"play": -1.0}),
    "upper_flank": Case(PLAY, {}, moves_inside_its_play, {"play": 1.0}),
    "multiple": Case(MULTIPLE, {}, moves_inside_its_play, {"play": 0.3}),
    "in_motion": Case(
        {"short_circuit_b": 0.4, "gain": 0.1},
        {},
        brakes,
        {"position": 3e-4, "speed": -90.0, "current": 3.0},
    ),
    "pid": Case(
        MULTIPLE,
        {},
        moves_inside_its_play,
        {"position": 1e-4, "speed": 20.0, "current": -1.5, "play": -0.4},
        {"GAI": 0.5, "GAD": 1e-7},
    ),
    "pd": Case(MULTIPLE, {}, moves_inside_its_play, {"speed": 20.0}, {"GAD": 1e-7}),
    "end_stop": Case(
        {"eccentricity": 0.5, "eccentricity_phase": 0.3},
        happens=at_end_stop,
        parameters={"theta_stop": 1e-3, "tau": 0.1},
    ),
    "limits": Case(
        happens=at_torque_limit, parameters={"T_max": 0.5, "I_max": 9.0, "omega_max": 60.0}
    ),
    "another_motor": Case(
        MULTIPLE,
        happens=moves_inside_its_play,
        parameters={"P": 5, "J_m": 4e-5, "R_s": 0.8, "h_b": 0.2, "f_ratio": 0.8},
    ),
    "load_stiffness": Case(PLAY, {"load_stiffness": -2.0}),
    "stribeck": Case({"friction": 0.2}, {"stribeck_speed": 5.0}),
    "all_deviations": Case({}, UNIT),
    "all_and_faults": Case(MULTIPLE, UNIT, moves_inside_its_play, {"play": 0.3}),
}
# The 100 ms of the fast form include a growing oscillation, the 5 ms of the source form a fast one.
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


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("case", CASES)
def test_kernel_equals_twin(case, form):
    """The deviations belong to the unit or to an individual."""
    faults, deviations, happens, start, parameters = CASES[case]
    dt, period, frequency = FORMS[form]
    steps = round(period / dt)
    t = period * np.arange(STEPS // steps + 1)
    # Small at first, so that nothing saturates, then large enough to saturate everything.
    amplitude = np.where(t < 0.4 * t[-1], 1.5e-4, 0.02)
    command = start.get("position", 0.0) + amplitude * np.sin(2 * np.pi * frequency * t)
    actuator = ActuatorParameters().replace(parameters)
    twin = twin_of(actuator, faults, form, deviations, command=float(command[0]), **start)

    seen = []
    current, speed = twin.samples(command.tolist(), steps, lambda twin: seen.append(happens(twin)))
    window = window_from(command, sample_period=period, **start)
    k, play = fault_vector(faults), start.get("play", 0.0)
    whole = MonitorModel(actuator, form, dt, unit(form, deviations)).respond(window, k, play)
    row = np.array([[deviations.get(name, 0.0) for name in NAMES]])
    individual = MonitorModel(actuator, form, dt, unit(form)).respond(
        window, k, play, deviations=row
    )
    for response in (whole, individual):
        assert response.current.shape == response.speed.shape == (1, len(t) - 1)
        assert response.current[0] == pytest.approx(current, abs=TOLERANCE, rel=0)
        assert response.speed[0] == pytest.approx(speed, abs=SPEED_TOLERANCE, rel=0)
    assert sum(seen) >= 20
