# SPDX-License-Identifier: Apache-2.0
"""Windows and settings that give no estimate, and the reasons."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.cause_profiles import Profile
from ema_core.causes import CAUSE_BY_NAME
from ema_core.description import ActuatorDescription
from ema_core.faults import estimation_error, fault_vector
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.reasons import NoCalibration, StatedReason
from ema_monitor.windows.trigger import Refusal
from ema_sim.actuator import SimulatedActuator

from .reference_cases import CASES
from .windows import changed

OTHER_UNIT = ActuatorDescription(serial_number="SIM-0002")
OTHER_MOTOR = ActuatorDescription(parameters=ActuatorParameters(R_s=2.3))


@pytest.fixture(scope="module")
def window(windows_of):
    [window] = windows_of(CASES["friction low"])
    return window


def check_refused(estimate: Estimate, *texts: str):
    assert not estimate.valid
    for words in texts:
        assert words in estimate.reason
    assert np.all(np.isnan(estimate.faults))
    assert np.all(np.isnan(estimate.covariance))
    assert np.all(estimate.unobservable)
    assert np.isnan(estimate.play_offset)
    assert np.isnan(estimate.fitness)
    assert np.isnan(estimate.goodness_of_fit)
    assert estimate.evaluations == 0


def standing(t: Telemetry, flows: float) -> dict[str, np.ndarray]:
    """Return the columns of a motor that stands still while a current flows."""
    return {
        "speed": 0.0 * t.speed,
        "position": 0.0 * t.position,
        "current": 0.0 * t.current + flows,
    }


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize(
    ("columns", "texts", "verdict"),
    [
        # 0.09 of twice 5 mrad.
        (
            lambda t: {"command": 0.09 * t.command},
            ("no excitation", "travels 0.0009 rad", "0.001 rad"),
            "refused",
        ),
        (
            lambda t: {"sample_period": 2e-4},
            ("the sample period is 0.0002 s, in the calibration of flap (SIM-0001) 0.0001 s",),
            "refused",
        ),
        # The defects differ in whether the demanded current flows.
        (
            lambda t: standing(t, 0.0),
            ("dead switch or open phase A, B or C: the motor stands still", "0.0 A flow"),
            "failed",
        ),
        (
            lambda t: standing(t, 22.0),
            ("jam: the motor stands still although 22.0 A flow", "the shaft is blocked"),
            "failed",
        ),
        (
            lambda t: {"speed": 0.0 * t.speed, "position": t.command},
            ("dead speed sensor: its value is 0 throughout",),
            "failed",
        ),
    ],
    ids=["hardly moves", "sample period", "open", "jam", "dead sensor"],
)
def test_hopeless_window_is_refused_even_if_forced(
    window, calibration, description, columns, texts, verdict, force
):
    unfit = changed(window, **columns(window.telemetry))
    estimate = identify(unfit, description, calibration, force=force)
    check_refused(estimate, *texts)
    assert (estimate.start_ns, estimate.end_ns) == (unfit.start_ns, unfit.end_ns)
    assert (estimate.verdict, estimate.calibration_id) == (verdict, calibration.calibration_id)


@pytest.mark.parametrize("cause", ["jam", "open_phase_a", "dead_switch"])
def test_defect_that_begins_within_a_window_is_named(window, calibration, description, cause):
    """It begins two fifths before the end: without current, the motor takes a while to stop."""
    actuator = SimulatedActuator()
    actuator.causes = {cause: Profile(1.0, start_s=0.3, end_s=0.3)}
    telemetry = actuator.advance(window.command)
    estimate = identify(replace(window, telemetry=telemetry), description, calibration)
    check_refused(estimate, CAUSE_BY_NAME[cause].label, "the motor stands still")


@pytest.mark.parametrize(
    ("described", "texts"),
    [(OTHER_UNIT, ("'SIM-0002'", "'SIM-0001'")), (OTHER_MOTOR, ("R_s = 2.3", "2.13"))],
)
def test_calibration_of_another_unit_is_refused_unless_forced(
    window, calibration, estimates, described, texts
):
    check_refused(identify(window, described, calibration), "calibration does not fit", *texts)
    estimate = identify(window, described, calibration, force=True)
    assert estimate.valid
    assert estimate.reason.startswith("forced although the actuator has ")
    assert texts[0] in estimate.reason
    # The calibration provides the model, so that the estimate belongs to the right unit.
    np.testing.assert_array_equal(estimate.faults, estimates("friction low").faults)


def test_only_a_refusal_for_lack_of_a_calibration_has_no_identity(window, calibration, description):
    """A drive that failed or stood still had its calibration in any case."""
    slower = changed(window, sample_period=2e-4)
    still = changed(window, **standing(window.telemetry, 22.0))
    cut = Refusal(0, 1, StatedReason("the calibration was running"))
    assert identify(window, description, NoCalibration("c.yaml")).lacks_calibration
    assert identify(window, OTHER_UNIT, calibration).lacks_calibration
    assert identify(slower, description, calibration).lacks_calibration
    assert not identify(still, description, calibration).lacks_calibration
    assert not identify(cut, description, NoCalibration("c.yaml")).lacks_calibration


def test_command_that_the_motion_did_not_follow_is_refused(window, calibration, description):
    reversed_window = changed(window, command=window.command[::-1].copy())
    estimate = identify(reversed_window, description, calibration)
    assert not estimate.valid
    assert estimate.verdict == "refused"
    assert "neither faults nor known causes explain the window" in estimate.reason


def test_part_of_a_window_is_estimated_with_the_wider_scatter(
    window, calibration, description, estimates
):
    shorter = replace(window, telemetry=window.telemetry.part(0, 3001))
    estimate = identify(shorter, description, calibration)
    assert estimate.valid
    assert estimation_error(estimate.faults, fault_vector(CASES["friction low"])) < 2.0
    assert estimate.sigma.friction > estimates("friction low").sigma.friction


def test_measured_current_with_nan_is_refused(window, calibration, description):
    """A trigger accepts no NaN, but a window made otherwise may have one."""
    current = window.telemetry.current.copy()
    current[1234] = np.nan
    estimate = identify(changed(window, current=current), description, calibration)
    check_refused(estimate, "no fault vector has a finite cost")
