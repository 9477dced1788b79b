# SPDX-License-Identifier: Apache-2.0
"""Healthy windows with a measured load or of ordinary motion, and their limits."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from ema_core.acquisition import Acquisition
from ema_core.commands import THESIS_CHIRP, Command
from ema_monitor.api import find_windows
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.model.deviations import N_DEVIATIONS, NAMES
from ema_monitor.model.measured import measured_causes, measured_ranges
from ema_monitor.windows.window import Window
from ema_sim.api import simulate

from .motion import FLAP, moved, moves, stretches_of
from .windows import window_from

LOAD = 0.3
LOAD_TORQUE = NAMES.index("load_torque")


@pytest.fixture(scope="module")
def loaded() -> list[Window]:
    """Return a healthy window under a load, twice."""
    return 2 * find_windows(simulate(causes={"load_torque": LOAD}))


def measured(windows: Sequence[Window], value: float, sigma: float = 0.01) -> list[Window]:
    causes = measured_causes({"load_torque": (value, sigma)})
    return [replace(window, measured=causes) for window in windows]


@pytest.mark.slow
def test_measured_load_is_no_deviation_of_the_unit_within_the_error_of_its_sensor(loaded):
    """Otherwise the load would become a deviation, and a window without load its opposite."""
    blind = calibrate_model(loaded)
    sure, seeing = (calibrate_model(measured(loaded, LOAD, sigma)) for sigma in (1e-4, 0.01))
    # The fit of the unit leaves 1.6 % of the load.
    assert blind.unit.load_torque == pytest.approx(LOAD, abs=0.005)
    assert seeing.unit.load_torque == pytest.approx(0.0, abs=0.005)
    assert seeing.unit.friction == pytest.approx(blind.unit.friction, abs=0.01)
    variance = (
        seeing.unit_covariance[LOAD_TORQUE, LOAD_TORQUE]
        - sure.unit_covariance[LOAD_TORQUE, LOAD_TORQUE]
    )
    # An offset of the current explains a fifth of it, limited by its prior.
    assert np.sqrt(variance) == pytest.approx(0.008, rel=0.15)


def test_measured_causes_of_a_calibration_are_reported_with_their_ranges(loaded):
    windows = [*measured(loaded, 0.3), *measured(loaded, 0.1)]
    expected = "load torque +0.1 ± 0.01 N.m to load torque +0.3 ± 0.01 N.m in 4 windows"
    assert measured_ranges(window.measured for window in windows) == expected
    assert measured_ranges(window.measured for window in loaded) == ""


def test_calibration_names_deviations_that_its_windows_did_not_show():
    """A test cycle of a healthy unit hardly shows its play or its viscous friction."""
    calibration = Calibration.builtin()
    assert calibration.not_learned == ("viscous_friction", "backlash")
    assert str(calibration).endswith("not learned from these windows: viscous friction, backlash")
    assert calibration.of_any_motion().not_learned == calibration.not_learned
    unfitted = replace(calibration, unit_covariance=np.zeros((N_DEVIATIONS, N_DEVIATIONS)))
    assert unfitted.not_learned == ()


def test_sensor_errors_of_columns_that_are_not_measured_are_not_listed():
    unknown = replace(Calibration.builtin(), unit_covariance=100.0 * np.eye(N_DEVIATIONS))
    assert {"current_delay", "speed_delay", "speed_loop"} <= set(unknown.not_learned)
    without = replace(unknown, acquisition=Acquisition(speed=False)).not_learned
    assert set(unknown.not_learned) - set(without) == {"speed_offset", "speed_gain", "speed_delay"}


def test_dwell_is_a_rest_of_the_command_for_twenty_milliseconds():
    ramp = np.linspace(0.0, 0.005, 1001)
    command = np.concatenate([ramp, np.full(500, 0.005), ramp[::-1], np.zeros(150)])
    moving = window_from(command).moves
    # A sample late or early at the start of the ramp: by then it has moved by a thousandth of its
    # travel.
    expected = np.ones(len(command) - 1, dtype=bool)
    expected[1000:1500] = False
    assert np.count_nonzero(moving != expected) <= 4
    # The last rest of 15 ms is too short.
    assert moving[-100:].all()


@pytest.mark.parametrize(
    "command",
    [THESIS_CHIRP, Command("sine", amplitude=0.01, start_frequency=4.0, duration=0.55)],
    ids=["chirp", "sine"],
)
def test_test_cycles_have_no_dwells(command):
    [window] = find_windows(simulate(command=command))
    assert window.moves.all()


def test_samples_are_weighted_by_speed_and_ignored_in_a_dwell():
    [stretch, *_] = stretches_of(moved(moves(3.0, rate=0.1), load=0.0))
    weights = stretch.weights
    assert np.mean(weights**2) == pytest.approx(1.0, rel=1e-12)
    assert not np.any(weights[~stretch.moves])
    speed = np.abs(stretch.telemetry.speed[1:])
    fast = speed > 0.8 * speed.max()
    assert weights[fast].min() > weights[speed < 0.05 * speed.max()].max()


@pytest.mark.slow
def test_motion_gives_the_same_friction_and_lift_as_the_test_cycle():
    """Slow motion alone separates the two if samples are weighted by speed."""
    windows = stretches_of(moved(moves(5.0, rate=0.2), load=0.0))
    unit, of_chirp = calibrate_model(windows, FLAP).unit, Calibration.builtin().unit
    # Without weights, they differ by 0.05 A each; their priors have widths of 0.1 and 0.125 A.
    assert unit.friction == pytest.approx(of_chirp.friction, abs=0.015)
    assert unit.lift == pytest.approx(of_chirp.lift, abs=0.02)
    assert unit.inertia == pytest.approx(of_chirp.inertia, abs=0.02)
