# SPDX-License-Identifier: Apache-2.0
"""Identification end to end: from telemetry of the simulated actuator to its faults."""

from dataclasses import fields, replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.faults import (
    ECCENTRICITY_PHASE,
    FRICTION,
    SHORT_CIRCUITS,
    degrade,
    estimation_error,
    fault_vector,
    healthy_faults,
)
from ema_core.parameters import constants
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.windows.trigger import WindowTrigger
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator, at_rest
from ema_sim.sensors import Sensors

from .reference_cases import CASES, TRUTH
from .windows import made_by

# Percent, at most about twice the largest value over five realisations of the PWM: 0.4, 0.5, 0.2,
# 0.2, 0.3, 0.6, 0.3, 0.5, 0.02, 0.25, 0.3 and 0.9. The thesis has 0.2 to 13.
LIMITS = {
    "healthy": 0.6,
    "friction low": 0.8,
    "friction high": 1.0,
    "backlash low": 0.4,
    "backlash high": 0.6,
    "short circuit low": 0.6,
    "short circuit high": 1.1,
    "eccentricity low": 0.6,
    "eccentricity high": 1.0,
    "gain low": 0.3,
    "gain high": 0.5,
    "multiple": 0.6,
    "wide": 1.3,
}
# Faults that have alternative explanations.
DOUBTS = {
    "multiple": ("this window cannot separate friction from viscous friction",),
    # If all phases are shorted, fewer turns in all of them look like a lower torque constant.
    "wide": ("this window cannot separate short circuit C from torque constant",),
}


def same(a: Estimate, b: Estimate) -> bool:
    """Return whether two estimates are bit-identical, except for their computing time."""
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=f.name != "unobservable")
        if isinstance(getattr(a, f.name), np.ndarray)
        else getattr(a, f.name) == getattr(b, f.name)
        for f in fields(Estimate)
        if f.name != "computing_time"
    )


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_faults_are_identified(estimates, case):
    estimate, truth = estimates(case), fault_vector(CASES[case])
    assert estimate.valid
    assert (estimate.reason == "") == (case not in DOUBTS)
    assert estimate.verdict == ("degraded" if case in DOUBTS else "valid")
    assert all(doubt in estimate.reason for doubt in DOUBTS.get(case, ()))
    assert estimation_error(estimate.faults, truth) < LIMITS[case]
    assert np.array_equal(fault_vector(estimate.faults), estimate.faults)
    assert estimate.play_offset == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("case", ["friction high", "backlash low", "multiple", "wide"])
def test_faults_are_identified_for_any_course_of_the_pwm(stirred_estimates, case):
    faults = stirred_estimates(case).faults
    assert estimation_error(faults, fault_vector(CASES[case])) < LIMITS[case]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_errors_of_faults_agree_with_their_sigma(estimates, case):
    """Measured: up to 2.2 sigma; all faults together are the worst case."""
    estimate, truth = estimates(case), fault_vector(CASES[case])
    observable, sigma = ~estimate.unobservable, np.array(estimate.sigma)
    assert np.all(np.abs(estimate.faults - truth)[observable] < 3.5 * sigma[observable])
    # The phase of an eccentricity of 0.0111 is known to 0.034 of a turn, if at all.
    observable[ECCENTRICITY_PHASE] &= case != "multiple"
    if case != "multiple":
        # Only the phase of an eccentricity of zero is unobservable.
        expected = np.zeros(8, dtype=bool)
        expected[ECCENTRICITY_PHASE] = "eccentricity" not in CASES[case]
        assert np.array_equal(estimate.unobservable, expected)
        assert np.array_equal(np.isnan(sigma), expected)
        assert not expected[ECCENTRICITY_PHASE] or estimate.faults[ECCENTRICITY_PHASE] == 0.5
    if case == "wide":
        # A torque constant that could replace the shorts scales all phases, and the friction.
        confused = [FRICTION, *SHORT_CIRCUITS]
        assert np.all((sigma[confused] > 0.012) & (sigma[confused] < 0.05))
        observable[confused] = False
    # The nominal play of the unit, which scales a large backlash, is known to 2 %; a short circuit
    # to 1.2 %, as the lift of unequal phases is unknown.
    assert np.all(sigma[observable] < (0.02 if case == "backlash high" else 0.012))


@pytest.mark.slow
def test_faults_that_a_healthy_window_does_not_show_are_exactly_healthy(
    stirred_window, description
):
    """The sensors are noisy and resolve 5 mA and 0.05 rad/s.

    At 95 %, seven groups let a third of the windows show some small fault.
    """
    resolution = {"current": 0.005, "position": 1e-6, "speed": 0.05}
    sensors = Sensors(0.05, resolution, np.random.default_rng(9))
    measured = [
        replace(window, telemetry=sensors.measure(window.telemetry))
        for window in (stirred_window({}, seed) for seed in range(40, 52))
    ]
    unit_calibration = calibrate_model(measured[:6], description)
    faults = np.stack(
        [identify(window, description, unit_calibration).faults for window in measured[6:]]
    )
    # Measured: 0.91. Without resetting the components, those at a bound alone give 0.3.
    assert np.mean(faults == healthy_faults()) > 0.8
    off = np.delete(np.abs(faults - healthy_faults()), ECCENTRICITY_PHASE, axis=1)
    assert np.max(off) < 0.01


def test_healthy_actuator_has_a_healthy_fit(estimates):
    # The residual of one window has about 5000 / 20 independent values: 6 % of scatter.
    assert estimates("healthy").goodness_of_fit == pytest.approx(1.0, abs=0.25)


def test_estimate_states_its_origin(estimates, windows_of, calibration):
    estimate = estimates("friction low")
    [window] = windows_of(CASES["friction low"])
    assert (estimate.start_ns, estimate.end_ns) == (window.start_ns, window.end_ns)
    assert estimate.end_ns - estimate.start_ns == 500_000_000
    assert (estimate.algorithm, estimate.seed) == ("least_squares", 0)
    assert estimate.calibration_id == calibration.calibration_id
    assert estimate.computing_time > 0.0


def test_model_identifies_its_own_response(healthy_windows, calibration, description):
    """A window simulated by the calibrated model leads back to its fault vector."""
    window = made_by(calibration, healthy_windows[0], TRUTH)
    estimate = identify(window, description, calibration)
    # Steps of the search end below 1e-3.
    assert estimate.faults == pytest.approx(fault_vector(TRUTH), abs=1e-3)
    assert estimate.fitness < 1e-6
    assert not np.any(estimate.unobservable)


@pytest.fixture(scope="module")
def without_approach(cycle):
    """Return a function that makes a window of a chirp from rest, at a position in the play."""

    def window(faults, play) -> Window:
        actuator = SimulatedActuator()
        actuator.faults = fault_vector(faults)
        plant = degrade(constants(actuator.parameters), actuator.faults)
        actuator.state = at_rest(theta_m=play * plant.mechanics.half_backlash)
        command = np.concatenate([np.zeros(1000), cycle.samples[cycle.start + 1 :]])
        [window] = WindowTrigger(actuator.parameters).feed(actuator.advance(command))
        assert isinstance(window, Window)
        assert window.play is None
        return window

    return window


@pytest.mark.parametrize(
    ("faults", "play", "tolerance"),
    [
        # Measured: 0.04 half-widths, at an error of 0.5 %.
        ({"backlash": 0.3, "gain": 0.6}, -1.0, 0.1),
        ({"backlash": 0.3, "gain": 0.6}, 0.5, 0.1),
        # In a small play, the position is not known, and affects no other fault.
        ({"friction": 0.25}, -1.0, 2.0),
    ],
)
def test_unknown_position_in_the_play_is_estimated(
    without_approach, calibration, description, faults, play, tolerance
):
    estimate = identify(without_approach(faults, play), description, calibration)
    assert estimate.valid
    assert -1.0 <= estimate.play_offset <= 1.0
    assert estimate.play_offset == pytest.approx(play, abs=tolerance)
    assert estimation_error(estimate.faults, fault_vector(faults)) < 1.0
    assert estimate.covariance.shape == (8, 8)


def test_same_seed_gives_the_same_estimate_wherever_the_unit_is_fitted(
    windows_of, calibration, estimates
):
    [window] = windows_of(CASES["multiple"])
    estimate = identify(window, ActuatorDescription(actuator_id="rudder"), calibration)
    assert same(estimate, estimates("multiple"))
