"""A column in another unit is named with its factor, and no fault is found in it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor import calibrate, find_windows, identify
from ema_sim import simulate

ROOT = 2.0**0.5
GEAR = 500.0


@pytest.fixture(scope="module")
def telemetry() -> Telemetry:
    return simulate({"friction": 0.25, "short_circuit_a": 0.15}, current_noise=0.02, seed=5)


def scaled(telemetry: Telemetry, **factors: float) -> Telemetry:
    return replace(telemetry, **{name: k * getattr(telemetry, name) for name, k in factors.items()})


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"current": ROOT}, "the current is 1.4[12] times .*: is a peak given for RMS?"),
        ({"current": 1.0 / ROOT}, "the current is 0.7[01]\\d? times .*: is RMS given for a peak?"),
        ({"current": 2.0}, "the current is (2|2.0\\d|1.9\\d) times what the inertia asks for"),
        ({"current": 1e3}, "the current is (1e|9.9\\de)\\+0[23] times .*: are these thousandths"),
        ({"current": -1.0}, "the current is -1 times .*: is its sign the other one?"),
        ({"position": 180.0 / np.pi}, "the position is 57.3 times .*: is it in degrees?"),
        ({"position": -1.0}, "the position is -1 times .*: is its sign"),
        ({"speed": 30.0 / np.pi}, "the speed is 9.55 times .*: is it in rpm?"),
        ({"speed": 1.0 / GEAR}, "the speed is 0.002 times .*: is the gear ratio in it"),
        ({"command": 2.0, "position": 2.0}, "the position and command is 2 times what the speed"),
        ({"command": -1.0}, "the command is -1.\\d+ times .*: is its sign"),
    ],
)
def test_wrong_scale_is_named_and_no_fault_is_found_in_it(telemetry, factors, words):
    [window] = find_windows(scaled(telemetry, **factors))
    estimate = identify(window)
    assert not estimate.valid
    assert np.all(np.isnan(estimate.faults))

    assert re.match(words, estimate.reason), estimate.reason


def test_one_factor_of_all_columns_is_taken_for_friction(telemetry):
    of_all = dict.fromkeys(("command", "current", "position", "speed"), 1.05)
    [window] = find_windows(scaled(telemetry, **of_all))
    assert identify(window).faults.friction == pytest.approx(0.289, abs=0.005)


@pytest.mark.parametrize("samples", [10, 50])
def test_late_position_changes_no_fault(telemetry, samples):
    late = np.roll(telemetry.position, samples)
    late[:samples] = telemetry.position[0]
    [as_it_is] = find_windows(telemetry)
    [window] = find_windows(replace(telemetry, position=late))
    # The search starts from the same samples, but for what the position tells of the travel.
    assert identify(window).faults == pytest.approx(identify(as_it_is).faults, abs=1e-3)


@pytest.mark.parametrize(("factor", "is_named"), [(1.0, False), (1.02, True), (1.1, True)])
def test_calibration_names_a_sample_period_that_is_not_that_of_the_motion(factor, is_named):
    h = 1e-4 * factor
    description = replace(ActuatorDescription(), sample_period=h)
    healthy = [simulate({}, current_noise=0.02, seed=10 + n) for n in range(3)]
    windows = [
        window
        for one in healthy
        for window in find_windows(replace(one, sample_period=h), description)
    ]
    words = f"the position travels {1.0 / factor:.3g} times what speed and time give"
    assert (words in str(calibrate(windows, description))) == is_named


@pytest.mark.parametrize(
    "faults",
    [
        {"short_circuit_a": 0.3, "short_circuit_b": 0.3, "short_circuit_c": 0.3},
        {"short_circuit_b": 0.6},
        {"friction": 0.9},
        {"eccentricity": 0.6},
    ],
)
def test_fault_is_not_taken_for_a_wrong_scale(faults):
    [window] = find_windows(simulate(faults, current_noise=0.02, seed=7))
    estimate = identify(window)
    assert estimate.valid, estimate.reason
    for name, value in faults.items():
        assert getattr(estimate.faults, name) == pytest.approx(value, abs=0.03)
