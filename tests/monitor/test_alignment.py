import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.alignment import difference_at, moved, shift_between
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.windows.trigger import TriggerSettings, WindowTrigger
from ema_monitor.windows.window import Window

CHIRP = 1e-3 * np.sin(2 * np.pi * 15.0 * (np.arange(1000) / 1000.0) ** 2)


@pytest.mark.parametrize("shift", [-60, -7, 0, 1, 60])
def test_shift_is_found_under_noise(shift):
    command = CHIRP[100 + shift : 800 + shift] + np.random.default_rng(1).normal(0, 1e-6, 700)
    reference = CHIRP[100:800]
    assert shift_between(command, reference, 1e-4) == shift
    # What is left is the noise.
    assert difference_at(command, reference, shift) == pytest.approx(1e-6, rel=0.1)


@pytest.mark.parametrize("shift", [-2, 0, 1])
def test_few_samples_of_a_slow_stream_are_laid_over_each_other(shift):
    """Of 100 samples at 200 Hz, shifts of 60 would leave nothing to compare."""
    slow = CHIRP[::9][:111]
    command = slow[5 + shift : 105 + shift] + np.random.default_rng(1).normal(0, 1e-4, 100)
    assert shift_between(command, slow[5:105], 5e-3) == shift


def test_moved_row_holds_its_ends():
    row = np.array([1.0, 2.0, 3.0])
    assert moved(row, 1).tolist() == [2.0, 3.0, 3.0]
    assert moved(row, -1).tolist() == [1.0, 1.0, 2.0]
    assert moved(row, 0).tolist() == row.tolist()


def test_windows_with_a_noisy_command_are_averaged_in_step(healthy_windows):
    """Their starts jitter, their currents do not."""
    description = ActuatorDescription()
    rng = np.random.default_rng(5)
    jittered = []
    for window in healthy_windows:
        t = window.telemetry
        rest = 800
        command = np.concatenate([np.full(rest, t.command[0]), t.command, np.full(300, 0.0)])
        current, position, speed = (
            np.pad(column, (rest, 300), "edge") for column in (t.current, t.position, t.speed)
        )
        noisy = command + rng.normal(0.0, 3e-7, len(command))
        stream = Telemetry(0, t.sample_period, 1, noisy, current, position, speed)
        trigger = WindowTrigger(description.parameters, TriggerSettings(threshold=2.5e-6))
        [found] = [event for event in trigger.feed(stream) if isinstance(event, Window)]
        jittered.append(Window(found.telemetry, window.play))
    starts = {window.telemetry.first_index for window in jittered}
    assert len(starts) > 1
    calibration = calibrate_model(jittered, description)
    sharp = calibrate_model(healthy_windows, description)
    # Out of step by a sample, the residual at each reversal would show in the scatter.
    assert calibration.healthy_rms < 1.3 * sharp.healthy_rms
