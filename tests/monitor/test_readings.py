# SPDX-License-Identifier: Apache-2.0
"""Wrong readings of columns: contradictions between columns, and named units."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from ema_core.columns.wording import error_text
from ema_core.commands import Command
from ema_core.description import ActuatorDescription
from ema_core.faults import GAIN, healthy_faults
from ema_core.parameters import ActuatorParameters, constants
from ema_core.telemetry import Telemetry
from ema_monitor import calibrate, find_windows, identify
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.identification.column_scale import wrong_scale
from ema_monitor.identification.evidence import Evidence
from ema_monitor.identification.objective import Objective, Relations
from ema_monitor.model.deviations import COLUMNS, NAMES, hidden_causes
from ema_monitor.model.measured import measured_causes
from ema_monitor.model.readings import read
from ema_monitor.windows.relations import law_offset, travel_ratio
from ema_sim import simulate

from .windows import changed, recorded, window_from

PARAMETERS = ActuatorParameters()
# The largest distance from its command at which friction holds the shaft.
HELD = constants(PARAMETERS).mechanics.f_s / (PARAMETERS.GAP * PARAMETERS.G_prop)


def columns(**values):
    return np.array([[values.get(name, 0.0) for name in COLUMNS]])


def test_late_command_appears_as_early_current_and_speed(healthy_windows):
    deviations, position = read(columns(command_delay=1e-3, current_delay=2e-4), healthy_windows[0])
    by_name = dict(zip(NAMES, deviations[0], strict=True))
    assert by_name["current_delay"] == pytest.approx(-8e-4)
    assert by_name["speed_delay"] == pytest.approx(-1e-3)
    assert position[0] == healthy_windows[0].telemetry.position[0]


def test_wrong_position_appears_as_a_wrong_initial_position():
    window = window_from(np.zeros(10), position=0.0102 * 1.02)
    _, position = read(columns(position_gain=0.02, position_offset=2e-4 * 1.02), window)
    assert position[0] == pytest.approx(0.01)


@pytest.mark.slow
def test_offset_within_the_reach_of_friction_is_not_a_fault(calibration, description):
    """It is too small to be named: the fit at the start is worse, but the faults are healthy."""
    estimate = identify(recorded({}, {"position_offset": 0.4 * HELD}), description, calibration)
    assert np.array_equal(estimate.faults, healthy_faults())
    assert estimate.causes == ()
    assert estimate.verdict == "valid"
    assert 2.0 < estimate.goodness_of_fit < 3.5


@pytest.mark.slow
def test_slow_sine_does_not_separate_a_small_gain_from_a_delay(calibration, description):
    """The estimate states this, and the sigma of the gain is not small."""
    sine = Command(shape="sine", amplitude=0.01, start_frequency=4.0, duration=0.55)
    estimate = identify(recorded({}, {}, sine), description, calibration)
    assert estimate.verdict == "degraded"
    assert (("gain",), ("command_delay",)) in estimate.alternatives
    assert "cannot separate gain from" in estimate.reason
    assert abs(estimate.faults.gain - 0.5) < 1.5 * estimate.sigma.gain


def test_travel_from_two_sensors_gives_the_ratio_of_their_gains():
    window = recorded({"backlash": 0.05}, {"position_gain": 0.02, "speed_offset": 1.0})
    ratio = travel_ratio(window, PARAMETERS)
    assert ratio is not None
    assert ratio.value == pytest.approx(1.02, abs=2e-4)
    assert ratio.sigma == pytest.approx(3e-4, rel=0.5)


def test_control_law_gives_the_offset_of_the_position_for_any_friction_and_load():
    for faults, causes in (({}, {}), ({"friction": 0.3}, {"load_torque": 0.2})):
        window = recorded(faults, {**causes, "position_offset": 2e-4})
        offset = law_offset(window, PARAMETERS)
        assert offset is not None
        assert offset.value == pytest.approx(2e-4, abs=2.0 * offset.sigma)
        assert offset.sigma < 0.3 * HELD


@pytest.mark.parametrize(("name", "value"), [("speed_offset", -5.0), ("current_offset", 3.0)])
def test_control_law_attributes_offsets_of_other_sensors_to_them(calibration, name, value):
    relations = Relations.of(recorded({}, {name: value}), calibration)
    assert not relations.are_healthy
    assert np.all(np.abs(relations.residuals(columns(**{name: value}))) < 0.5)


def test_nothing_is_stated_for_windows_at_rest_or_drives_with_another_law(healthy_windows):
    still = window_from(np.zeros(5001))
    assert travel_ratio(still, PARAMETERS) is None
    assert law_offset(still, PARAMETERS) is None
    for gains in ({"GAI": 1.0}, {"GAD": 1e-6}):
        assert law_offset(healthy_windows[0], PARAMETERS.replace(gains)) is None


def test_relations_are_judged_relative_to_the_healthy_windows(healthy_windows, calibration):
    """If the calibration lacks the healthy relations, nothing is stated."""
    window = healthy_windows[0]
    relations = Relations.of(window, calibration)
    assert relations.are_healthy
    assert np.all(np.abs(relations.residuals(columns())) < 0.5)
    assert relations.residuals(columns()).shape == (1, 2)
    unknown = replace(calibration, travel_ratio=math.nan, law_offset=math.nan)
    assert Relations.of(window, unknown).residuals(columns()).shape == (1, 0)
    # Two sensors with the same wrong factor agree on the travel.
    both = relations.residuals(columns(position_gain=0.01, speed_gain=0.01))
    assert both[0, 0] == pytest.approx(relations.residuals(columns())[0, 0])


def test_unusual_cause_costs_its_distance_for_any_quality_of_the_fit(healthy_windows, calibration):
    """Four sigma cost 16, whether the residual is noise alone or ten times as large."""
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
        # A cause that hardly changes this window.
        [place] = [i for i, cause in enumerate(causes) if cause.name == "supply_voltage"]
        point = at.point.copy()
        point[numbers[place]] += 4.0 * causes[place].sigma / (2.0 * causes[place].reach)
        away = objective.linearise(point)
        assert objective.surprise(point) - objective.surprise(at.point) == pytest.approx(16.0)
        assert evidence.against(away, at) == pytest.approx(16.0, abs=2.0)
    assert objective.encode(healthy_faults())[GAIN] == 0.5


@pytest.mark.slow
def test_readings_measured_in_healthy_windows_are_not_deviations_of_the_unit(description):
    """If their errors are measured, wrong readings give the same calibration as correct ones."""
    measured_values = {"position_gain": (0.02, 1e-3), "position_offset": (5e-4, 1e-5)}
    value = {name: item[0] for name, item in measured_values.items()}
    plain, wrong = recorded({}, {}), recorded({}, value)
    measured = replace(wrong, measured=measured_causes(measured_values))
    ours, theirs = (calibrate_model([item], description) for item in (plain, measured))
    assert theirs.travel_ratio == pytest.approx(ours.travel_ratio, abs=1e-4)
    assert theirs.law_offset == pytest.approx(ours.law_offset, abs=0.05 * HELD)
    assert theirs.unit.friction == pytest.approx(ours.unit.friction, abs=0.01)
    assert np.std(theirs.correction - ours.correction) < 0.05


@pytest.fixture(scope="module")
def telemetry() -> Telemetry:
    return simulate({"friction": 0.25, "short_circuit_a": 0.15}, current_noise=0.02, seed=5)


def scaled(telemetry: Telemetry, **factors: float) -> Telemetry:
    return replace(telemetry, **{name: k * getattr(telemetry, name) for name, k in factors.items()})


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"current": 2.0**0.5}, "the current is 1.4[12] times .*: is a peak given for RMS?"),
        ({"current": 0.5**0.5}, "the current is 0.7[01]\\d? times .*: is RMS given for a peak?"),
        ({"current": 2.0}, "the current is (2|2.0\\d|1.9\\d) times what the inertia implies"),
        ({"current": 1e3}, "the current is (1e|9.9\\de)\\+0[23] times .*: are these thousandths"),
        ({"current": -1.0}, "the current is -1 times .*: is its sign reversed?"),
        ({"position": 180.0 / np.pi}, "the position is 57.3 times .*: is it in degrees?"),
        # No motor that stands still.
        ({"speed": PARAMETERS.tau}, "the speed is 0.002 times .*: was the gear ratio applied"),
    ],
)
def test_wrong_scale_is_named_and_not_mistaken_for_a_fault(telemetry, factors, words):
    [window] = find_windows(scaled(telemetry, **factors))
    estimate = identify(window)
    assert not estimate.valid
    assert np.all(np.isnan(estimate.faults))
    assert re.match(words, estimate.reason), estimate.reason


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"position": -1.0}, "the position is -1 times .*: is its sign"),
        ({"speed": 30.0 / np.pi}, "the speed is 9.55 times .*: is it in rpm?"),
        ({"command": 2.0, "position": 2.0}, "the position and command is 2 times what the speed"),
        ({"command": -1.0}, "the command is -1.\\d+ times .*: is its sign"),
    ],
)
def test_scale_that_columns_contradict_is_named(telemetry, factors, words):
    [window] = find_windows(scaled(telemetry, **factors))
    scale = wrong_scale(window, PARAMETERS)
    assert scale is not None
    assert re.match(words, error_text(scale))


def test_common_factor_of_all_columns_is_mistaken_for_friction(telemetry):
    of_all = dict.fromkeys(("command", "current", "position", "speed"), 1.05)
    [window] = find_windows(scaled(telemetry, **of_all))
    assert identify(window).faults.friction == pytest.approx(0.289, abs=0.005)


def test_late_position_changes_no_fault(telemetry):
    late = np.concatenate([np.full(50, telemetry.position[0]), telemetry.position[:-50]])
    [as_it_is] = find_windows(telemetry)
    [window] = find_windows(replace(telemetry, position=late))
    # The search starts from the same samples, except for the travel seen by the position.
    assert identify(window).faults == pytest.approx(identify(as_it_is).faults, abs=1e-3)


@pytest.mark.parametrize(("factor", "is_named"), [(1.0, False), (1.02, True)])
def test_calibration_names_a_sample_period_that_contradicts_the_motion(
    healthy_windows, factor, is_named
):
    h = 1e-4 * factor
    windows = [changed(window, sample_period=h) for window in healthy_windows[:1]]
    words = f"the position travels {1.0 / factor:.3g} times the integral of the speed"
    description = replace(ActuatorDescription(), sample_period=h)
    assert (words in str(calibrate(windows, description))) == is_named


@pytest.mark.parametrize(
    "faults",
    [{"short_circuit_a": 0.3, "short_circuit_b": 0.3, "short_circuit_c": 0.3}, {"friction": 0.9}],
)
def test_fault_is_not_mistaken_for_a_wrong_scale(faults):
    [window] = find_windows(simulate(faults, current_noise=0.02, seed=7))
    estimate = identify(window)
    assert estimate.valid, estimate.reason
    for name, value in faults.items():
        assert getattr(estimate.faults, name) == pytest.approx(value, abs=0.03)
