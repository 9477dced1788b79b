"""Healthy windows under a load that was measured, and what a calibration could not learn."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import N_FAULTS
from ema_monitor.api import find_windows
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.identification.verdict import resting_on_unit
from ema_monitor.model.deviations import N_DEVIATIONS, NAMES
from ema_monitor.model.measured import measured_causes, taken_for_known
from ema_monitor.windows.window import Window
from ema_sim.api import simulate

LOAD = 0.3
LOAD_TORQUE = NAMES.index("load_torque")


@pytest.fixture(scope="module")
def loaded() -> list[Window]:
    """A healthy window under a load, twice."""
    return 2 * find_windows(simulate(causes={"load_torque": LOAD}))


def measured(windows: Sequence[Window], value: float, sigma: float = 0.01) -> list[Window]:
    known = measured_causes({"load_torque": (value, sigma)})
    return [replace(window, measured=known) for window in windows]


@pytest.mark.slow
def test_a_measured_load_is_none_of_the_unit(loaded):
    """Otherwise the unit has it for good, and a window without load shows the opposite."""
    blind, seeing = calibrate_model(loaded), calibrate_model(measured(loaded, LOAD))
    # 1.6 % of the load is what the fit of the unit leaves.
    assert blind.unit.load_torque == pytest.approx(LOAD, abs=0.005)
    assert seeing.unit.load_torque == pytest.approx(0.0, abs=0.005)
    assert seeing.unit.friction == pytest.approx(blind.unit.friction, abs=0.01)


@pytest.mark.slow
def test_sigma_of_the_measured_load_is_part_of_what_is_known_of_the_unit(loaded):
    """Of the load that the windows show, the unit may have what the sensor is wrong by."""
    sigma = [
        np.sqrt(
            calibrate_model(measured(loaded, LOAD, one)).unit_covariance[LOAD_TORQUE, LOAD_TORQUE]
        )
        for one in (1e-4, 0.01)
    ]
    # An offset of the current, as far as its prior lets it, takes a fifth of it.
    assert np.sqrt(sigma[1] ** 2 - sigma[0] ** 2) == pytest.approx(0.008, rel=0.15)


def test_windows_without_measurement_give_the_calibration_that_they_gave(healthy_windows):
    one, other = (
        calibrate_model([replace(window, measured=known) for window in healthy_windows[:2]])
        for known in ((), measured_causes({"load_torque": (0.0, 1e-9)}))
    )
    np.testing.assert_allclose(one.unit, other.unit, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(one.unit_covariance, other.unit_covariance, rtol=1e-6, atol=1e-15)


def test_what_was_taken_for_known_is_said_with_its_range(loaded):
    windows = [*measured(loaded, 0.3), *measured(loaded, 0.1)]
    expected = "load torque +0.1 ± 0.01 N.m to load torque +0.3 ± 0.01 N.m in 4 windows"
    assert taken_for_known(one.measured for one in windows) == expected
    assert taken_for_known(one.measured for one in loaded) == ""


def test_calibration_says_what_its_windows_did_not_show():
    """A test cycle of a healthy unit hardly shows its play, nor viscous friction."""
    calibration = Calibration.builtin()
    assert calibration.not_learned == ("viscous_friction", "backlash")
    assert str(calibration).endswith("not learned from these windows: viscous friction, backlash")
    assert calibration.of_any_motion().not_learned == calibration.not_learned
    unfitted = replace(calibration, unit_covariance=np.zeros((N_DEVIATIONS, N_DEVIATIONS)))
    assert unfitted.not_learned == ()


def test_fault_whose_uncertainty_is_that_of_the_unit_says_so():
    """Half of the variance of the friction, and little of that of the backlash."""
    steps = np.zeros((2, N_DEVIATIONS))
    steps[0, NAMES.index("viscous_friction")] = 0.5
    steps[1, NAMES.index("inertia")] = 0.1
    shifts = np.zeros((N_FAULTS, 2))
    shifts[0] = (0.015, 0.005)
    shifts[1] = (0.005, 0.0)
    sigma = np.full(N_FAULTS, 0.02)

    def said(*not_learned: str) -> list[str]:
        return resting_on_unit(sigma, shifts, steps, not_learned)

    expected = (
        "how well friction is known rests on the viscous friction of the unit, which its "
        "calibration could not learn"
    )
    assert said("viscous_friction") == [expected]
    assert said("inertia") == said() == []
    # Where it is known well all the same, it does not matter.
    assert resting_on_unit(0.1 * sigma, 0.1 * shifts, steps, ["viscous_friction"]) == []
