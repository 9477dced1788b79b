"""Wrong readings of command and position, and what the columns of a window say of each other."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ema_core.commands import Command
from ema_core.faults import GAIN, healthy_faults
from ema_core.parameters import ActuatorParameters, constants
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.identification.evidence import Evidence
from ema_monitor.identification.objective import Objective, Relations
from ema_monitor.model.deviations import COLUMNS, NAMES, hidden_causes
from ema_monitor.model.measured import measured_causes
from ema_monitor.model.readings import read
from ema_monitor.windows.relations import law_offset, travel_ratio

from .windows import changed, recorded, window_from

PARAMETERS = ActuatorParameters()
# What friction holds the shaft off its command by, at most.
HELD = constants(PARAMETERS).mechanics.f_s / (PARAMETERS.GAP * PARAMETERS.G_prop)


def columns(**values):
    return np.array([[values.get(name, 0.0) for name in COLUMNS]])


def test_late_command_is_an_early_current_and_speed(healthy_windows):
    deviations, position = read(columns(command_delay=1e-3, current_delay=2e-4), healthy_windows[0])
    by_name = dict(zip(NAMES, deviations[0], strict=True))
    assert by_name["current_delay"] == pytest.approx(-8e-4)
    assert by_name["speed_delay"] == pytest.approx(-1e-3)
    assert position[0] == healthy_windows[0].telemetry.position[0]


def test_wrong_position_is_a_wrong_place_to_begin_at():
    window = window_from(np.zeros(10), position=0.0102 * 1.02)
    _, position = read(columns(position_gain=0.02, position_offset=2e-4 * 1.02), window)
    assert position[0] == pytest.approx(0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("command_delay", 2e-3),
        ("position_offset", 4e-5),
        ("position_offset", 5e-3),
        ("position_gain", -0.05),
    ],
)
def test_wrong_reading_is_named_and_no_fault(calibration, description, name, value):
    estimate = identify(recorded({}, {name: value}), description, calibration)
    assert (estimate.verdict, estimate.alternatives) == ("valid", ())
    assert np.array_equal(estimate.faults, healthy_faults())
    [cause] = estimate.causes
    assert cause.name == name
    # To first order a late command begins at rest.
    assert cause.value == pytest.approx(value, rel=0.01, abs=3.0 * cause.sigma)
    assert 4.0 * cause.sigma < abs(value)


@pytest.mark.slow
@pytest.mark.parametrize(
    "causes", [{"command_delay": 1e-3}, {"position_offset": -3e-4}, {"position_gain": 0.02}]
)
def test_gain_and_wrong_reading_are_told_apart(calibration, description, causes):
    """Measured up to .0014; without the hypothesis the delay is a gain of .78."""
    faults = {"gain": 0.35, "friction": 0.1}
    estimate = identify(recorded(faults, causes), description, calibration)
    assert {cause.name for cause in estimate.causes} == set(causes)
    assert estimate.verdict != "refused"
    for name, value in faults.items():
        assert getattr(estimate.faults, name) == pytest.approx(value, abs=0.006)


@pytest.mark.slow
def test_offset_within_what_friction_holds_is_no_fault(calibration, description):
    """Too small to be named: the fit at the start is worse, and the faults are healthy."""
    estimate = identify(recorded({}, {"position_offset": 0.4 * HELD}), description, calibration)
    assert np.array_equal(estimate.faults, healthy_faults())
    assert estimate.causes == ()
    assert estimate.verdict == "valid"
    assert 2.0 < estimate.goodness_of_fit < 3.5


@pytest.mark.slow
def test_slow_sine_does_not_tell_a_small_gain_from_a_delay(calibration, description):
    """It is said, and the gain has no small standard deviation."""
    sine = Command(shape="sine", amplitude=0.01, start_frequency=4.0, duration=0.55)
    estimate = identify(recorded({}, {}, command=sine), description, calibration)
    assert estimate.verdict == "degraded"
    assert ("gain", "delay of the command") in estimate.alternatives
    assert "cannot separate gain from" in estimate.reason
    assert abs(estimate.faults.gain - 0.5) < 1.5 * estimate.sigma.gain


def test_travel_by_two_sensors_gives_the_ratio_of_their_gains():
    window = recorded({"backlash": 0.05}, {"position_gain": 0.02, "speed_offset": 1.0})
    found = travel_ratio(window, PARAMETERS)
    assert found is not None
    assert found.value == pytest.approx(1.02, abs=2e-4)
    assert found.sigma == pytest.approx(3e-4, rel=0.5)


def test_control_law_gives_the_offset_of_the_position_whatever_friction_and_load_are():
    for faults, causes in (({}, {}), ({"friction": 0.3}, {"load_torque": 0.2})):
        window = recorded(faults, {**causes, "position_offset": 2e-4})
        found = law_offset(window, PARAMETERS)
        assert found is not None
        assert found.value == pytest.approx(2e-4, abs=2.0 * found.sigma)
        assert found.sigma < 0.3 * HELD


@pytest.mark.parametrize(("name", "value"), [("speed_offset", -5.0), ("current_offset", 3.0)])
def test_control_law_ascribes_offsets_of_other_sensors_to_them(calibration, name, value):
    found = Relations.of(recorded({}, {name: value}), calibration)
    assert not found.are_healthy
    assert np.all(np.abs(found.left(columns(**{name: value}))) < 0.5)


@pytest.mark.parametrize(
    "parameters",
    [PARAMETERS.replace({"GAI": 1.0}), PARAMETERS.replace({"GAD": 1e-6})],
    ids=["integral", "derivative"],
)
def test_no_offset_where_the_drive_has_another_law(healthy_windows, parameters):
    assert law_offset(healthy_windows[0], parameters) is None


def test_windows_at_rest_say_nothing_of_their_columns():
    still = window_from(np.zeros(5001))
    assert travel_ratio(still, PARAMETERS) is None
    assert law_offset(still, PARAMETERS) is None


def test_relations_are_judged_against_the_healthy_windows(healthy_windows, calibration):
    """And say nothing where the calibration does not know what is healthy."""
    window = healthy_windows[0]
    found = Relations.of(window, calibration)
    assert found.are_healthy
    assert np.all(np.abs(found.left(columns())) < 0.5)
    assert found.left(columns()).shape == (1, 2)
    unknown = replace(calibration, travel_ratio=math.nan, law_offset=math.nan)
    assert Relations.of(window, unknown).left(columns()).shape == (1, 0)
    # Both sensors wrong by as much agree on the travel.
    both = found.left(columns(position_gain=0.01, speed_gain=0.01))
    assert both[0, 0] == pytest.approx(found.left(columns())[0, 0])


def test_unusual_cause_costs_its_distance_however_bad_the_fit_is(healthy_windows, calibration):
    """Ten sigma are ten sigma, beside a residual of noise or of a mismatch ten times larger."""
    window = healthy_windows[0]
    causes = hidden_causes(PARAMETERS, window.excitation)
    for factor in (1.0, 10.0):
        noisy = window.telemetry.current + 0.1 * factor * np.random.default_rng(1).normal(
            size=len(window) + 1
        )
        objective = Objective(changed(window, current=noisy), calibration, causes=causes)
        numbers = range(objective.dimension - len(causes), objective.dimension)
        evidence = Evidence(objective, list(numbers))
        at = objective.linearise(objective.healthy)
        # Of a cause that hardly changes this window.
        [place] = [i for i, one in enumerate(causes) if one.name == "supply_voltage"]
        point = at.point.copy()
        point[numbers[place]] += 4.0 * causes[place].sigma / (2.0 * causes[place].reach)
        away = objective.linearise(point)
        assert objective.surprise(point) - objective.surprise(at.point) == pytest.approx(16.0)
        assert evidence.against(away, at) == pytest.approx(16.0, abs=2.0)
    assert objective.encode(healthy_faults())[GAIN] == 0.5


@pytest.mark.slow
def test_readings_measured_beside_healthy_windows_are_not_of_the_unit(description):
    """A calibration under them knows the unit as one without them does."""
    known = {"position_gain": (0.02, 1e-3), "position_offset": (5e-4, 1e-5)}
    value = {name: one[0] for name, one in known.items()}
    plain, wrong = recorded({}, {}), recorded({}, value)
    measured = replace(wrong, measured=measured_causes(known))
    ours, theirs = (calibrate_model([one], description) for one in (plain, measured))
    assert theirs.travel_ratio == pytest.approx(ours.travel_ratio, abs=1e-4)
    assert theirs.law_offset == pytest.approx(ours.law_offset, abs=0.05 * HELD)
    assert theirs.unit.friction == pytest.approx(ours.unit.friction, abs=0.01)
    assert np.std(theirs.correction - ours.correction) < 0.05
