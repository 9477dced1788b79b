"""Ordinary motion as healthy windows: what counts in them, and the unit that they give."""

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP, Command
from ema_monitor.api import find_windows
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_sim.api import simulate

from .motion import FLAP, H, moved, moves, stretches_of
from .windows import window_from


def test_a_dwell_is_where_the_command_rests_for_twenty_milliseconds():
    ramp = np.linspace(0.0, 0.005, 1001)
    command = np.concatenate([ramp, np.full(500, 0.005), ramp[::-1], np.zeros(150)])
    moving = window_from(command).moves
    # A sample late or early where the ramp begins: it has moved by a thousandth of its travel.
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
def test_test_cycles_do_not_dwell(command):
    [window] = find_windows(simulate(command=command))
    assert window.moves.all()


def test_samples_count_by_speed_and_not_at_all_in_a_dwell():
    [stretch, *_] = stretches_of(moved(moves(3.0, rate=0.1), load=0.0))
    weights = stretch.weights
    assert np.mean(weights**2) == pytest.approx(1.0, rel=1e-12)
    assert not np.any(weights[~stretch.moves])
    speed = np.abs(stretch.telemetry.speed[1:])
    fast = speed > 0.8 * speed.max()
    assert weights[fast].min() > weights[speed < 0.05 * speed.max()].max()


@pytest.mark.slow
def test_motion_gives_the_friction_and_lift_that_the_test_cycle_gives():
    """Slow motion alone tells the two apart where samples count by their speed."""
    windows = stretches_of(moved(moves(5.0, rate=0.2), load=0.0))
    unit, of_chirp = calibrate_model(windows, FLAP).unit, Calibration.builtin().unit
    # Without weights 0.05 and 0.05 A apart; their priors are 0.1 and 0.125 A wide.
    assert unit.friction == pytest.approx(of_chirp.friction, abs=0.015)
    assert unit.lift == pytest.approx(of_chirp.lift, abs=0.02)
    assert unit.inertia == pytest.approx(of_chirp.inertia, abs=0.02)


def test_a_calibration_on_test_cycles_alone_counts_all_samples_alike():
    """Their figures are those that they were before ordinary motion could calibrate."""
    [window] = find_windows(simulate())
    calibration = calibrate_model([window], FLAP)
    model = calibration.model().respond(window, np.array([0, 0, 0, 0, 0, 0, 0.5, 0.5]), 1.0)
    # The correction is what the model misses, sample by sample.
    np.testing.assert_allclose(
        calibration.correction, window.current - model.current[0], rtol=0, atol=1e-9
    )
    assert len(calibration.command) == round(0.5 / H) + 1
