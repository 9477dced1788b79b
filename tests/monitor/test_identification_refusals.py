"""Windows and settings that no estimate is made of, and why."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.cause_profiles import Profile
from ema_core.causes import CAUSE_BY_NAME
from ema_core.description import ActuatorDescription
from ema_core.faults import estimation_error, fault_vector
from ema_core.parameters import ActuatorParameters
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate
from ema_sim.actuator import SimulatedActuator

from .windows import changed

FAULTS = {"friction": 0.25}
OTHER_UNIT = ActuatorDescription(serial_number="SIM-0002")
OTHER_MOTOR = ActuatorDescription(parameters=ActuatorParameters(R_s=2.3))


@pytest.fixture(scope="module")
def window(windows_of):
    [window] = windows_of(FAULTS)
    return window


def check_refused(estimate: Estimate, *said: str):
    assert not estimate.valid
    for words in said:
        assert words in estimate.reason
    assert np.all(np.isnan(estimate.faults))
    assert np.all(np.isnan(estimate.covariance))
    assert np.all(estimate.unobservable)
    assert np.isnan(estimate.play)
    assert np.isnan(estimate.fitness)
    assert np.isnan(estimate.goodness_of_fit)
    assert estimate.evaluations == 0


@pytest.mark.parametrize("force", [False, True])
def test_command_that_hardly_moves_is_refused(window, calibration, description, force):
    """Whatever is forced: there is nothing to be found."""
    still = changed(window, command=0.09 * window.command)
    estimate = identify(still, description, calibration, force=force)
    # 0.09 of twice 5 mrad.
    check_refused(estimate, "no excitation", "travels 0.0009 rad", "0.001 rad")
    assert (estimate.start_ns, estimate.end_ns) == (window.start_ns, window.end_ns)
    assert estimate.calibration_id == calibration.calibration_id


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize(
    ("flows", "said"),
    [
        (0.0, ("dead switch or open phase A, B or C: the motor stands still", "0.0 A flow")),
        (22.0, ("jam: the motor stands still although 22.0 A flow", "the shaft is blocked")),
    ],
)
def test_motor_that_stands_still_is_refused_with_the_defect(
    window, calibration, description, flows, said, force
):
    """Which is told by whether the current flows that the loop wants."""
    still = np.zeros(len(window) + 1)
    stuck = changed(window, speed=still, position=still, current=still + flows)
    estimate = identify(stuck, description, calibration, force=force)
    check_refused(estimate, *said)


@pytest.mark.parametrize("cause", ["jam", "open_phase_a", "dead_switch"])
def test_defect_that_comes_up_within_a_window_is_named(window, calibration, description, cause):
    """Two fifths before its end: without current, the motor takes a while to come to rest."""
    actuator = SimulatedActuator()
    actuator.causes = {cause: Profile(1.0, start_s=0.3, end_s=0.3)}
    telemetry = actuator.advance(window.command)
    estimate = identify(replace(window, telemetry=telemetry), description, calibration)
    check_refused(estimate, CAUSE_BY_NAME[cause].label, "the motor stands still")


@pytest.mark.parametrize("force", [False, True])
def test_speed_that_stands_still_while_the_position_moves_is_a_dead_sensor(
    window, calibration, description, force
):
    still = np.zeros(len(window) + 1)
    idle = changed(window, speed=still, position=window.telemetry.command.copy())
    estimate = identify(idle, description, calibration, force=force)
    check_refused(estimate, "dead speed sensor: it says 0 throughout")
    assert estimate.verdict == "failed"


@pytest.mark.parametrize(
    ("described", "said"),
    [(OTHER_UNIT, ("'SIM-0002'", "'SIM-0001'")), (OTHER_MOTOR, ("R_s = 2.3", "2.13"))],
)
def test_calibration_of_another_unit_is_refused(window, calibration, described, said):
    check_refused(identify(window, described, calibration), "calibration does not fit", *said)


def test_command_that_the_motion_did_not_follow_is_refused(window, calibration, description):
    other = changed(window, command=window.command[::-1].copy())
    estimate = identify(other, description, calibration)
    assert not estimate.valid
    assert estimate.verdict == "refused"
    assert "neither faults nor known causes explain the window" in estimate.reason


@pytest.mark.parametrize("force", [False, True])
def test_calibration_for_another_sample_period_is_refused(window, calibration, description, force):
    slower = changed(window, sample_period=2e-4)
    estimate = identify(slower, description, calibration, force=force)
    check_refused(estimate, "the sample period is 0.0002 s", "0.0001 s")


def test_part_of_a_window_is_estimated_with_the_wider_scatter(window, calibration, description):
    shorter = replace(window, telemetry=window.telemetry.part(0, 3001))
    estimate = identify(shorter, description, calibration)
    assert estimate.valid
    assert estimation_error(estimate.faults, fault_vector(FAULTS)) < 2.0
    whole = identify(window, description, calibration)
    assert estimate.sigma.friction > whole.sigma.friction


@pytest.mark.parametrize(
    ("described", "said"), [(OTHER_UNIT, "serial number 'SIM-0002'"), (OTHER_MOTOR, "R_s = 2.3")]
)
def test_forced_estimate_says_so(window, calibration, described, said):
    estimate = identify(window, described, calibration, force=True)
    assert estimate.valid
    assert estimate.reason.startswith("forced although the actuator has ")
    assert said in estimate.reason
    # The model is the calibration's, so that the estimate is that of the right unit.
    assert estimation_error(estimate.faults, fault_vector(FAULTS)) < 1.5


def test_measured_current_that_is_no_number_is_refused(window, calibration, description):
    """A trigger lets none through; a window made otherwise may have one."""
    current = window.telemetry.current.copy()
    current[1234] = np.nan
    estimate = identify(changed(window, current=current), description, calibration)
    check_refused(estimate, "no fault vector gave a finite cost")
