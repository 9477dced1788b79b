"""Windows are found where the command says, whatever carries it."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP, approach_depth, approach_travel, build_cycle
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import COLUMNS
from ema_monitor.windows.trigger import TriggerSettings, WindowTrigger

from .streams import PERIOD_NS, START_NS, H, blocks, stream, windows_in

PARAMETERS = ActuatorParameters()
CYCLE = build_cycle(THESIS_CHIRP, H)
N = len(CYCLE.samples)
REST = np.zeros(1000)
CHIRP = THESIS_CHIRP.sample(H)


def last_at_rest(threshold):
    """Sample of the cycle, from 0, before the chirp passes the threshold."""
    chirp = CYCLE.samples[CYCLE.start :]
    return CYCLE.start + int(np.argmax(np.abs(chirp) > threshold)) - 1


def found(command, settings=None, size=100):
    trigger = WindowTrigger(PARAMETERS, settings)
    return windows_in(
        [event for block in blocks(stream(command), size) for event in trigger.feed(block)]
    )


def play_of(command):
    [window] = found(command)
    return window.play


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 7, 100, 5001, 3 * N])
def test_windows_are_found_at_the_same_samples_whatever_the_blocks(size):
    telemetry = stream(np.tile(CYCLE.samples, 3), first_index=41)
    trigger = WindowTrigger(PARAMETERS)
    windows = windows_in(
        [event for block in blocks(telemetry, size) for event in trigger.feed(block)]
    )
    assert len(windows) == 3
    for number, window in enumerate(windows):
        start = number * N + last_at_rest(1e-6)
        assert len(window) == 5000
        assert window.telemetry.first_index == 41 + start
        # Sample 41 + start ends so many periods of 100 us after the time of index 0.
        assert window.start_ns == START_NS + (41 + start) * PERIOD_NS
        assert window.end_ns == window.start_ns + 500_000_000
        for name in COLUMNS:
            expected = getattr(telemetry, name)[start : start + 5001]
            assert np.array_equal(getattr(window.telemetry, name), expected)
        assert window.play == 1.0
    assert trigger.finish() == []


def test_approach_is_passed_over():
    """Its motion ends before a window is full; how long it took is remembered."""
    trigger = WindowTrigger(PARAMETERS)
    assert trigger.feed(stream(CYCLE.samples[: CYCLE.start])) == []
    # 0.4 s up from -2 mrad, found to some samples.
    assert trigger.longest_motion_s == pytest.approx(0.4, abs=2e-3)
    assert trigger.finish() == []


def test_motion_one_way_is_passed_over_however_long():
    """An approach longer than a window shows nothing of the faults that need a reversal."""
    [window] = found(CYCLE.samples, TriggerSettings(window_s=0.3))
    assert window.telemetry.first_index > CYCLE.start
    slow = np.concatenate(
        [REST, np.linspace(0, -2e-3, 7000), REST - 2e-3, np.linspace(-2e-3, 0, 12_000), REST, CHIRP]
    )
    [window] = found(slow, TriggerSettings(window_s=0.4))
    assert window.telemetry.first_index > len(slow) - len(CHIRP)
    assert window.play == 1.0


@pytest.mark.parametrize("threshold", [1e-7, 1e-5, 1e-4])
def test_window_begins_before_the_command_passes_the_threshold(threshold):
    command = np.concatenate([REST, CHIRP])
    settings = TriggerSettings(window_s=0.4, threshold=threshold)
    [window] = found(command, settings)
    start = window.telemetry.first_index - 1
    assert abs(command[start]) <= threshold < abs(command[start + 1])
    assert start == len(REST) + int(np.argmax(np.abs(CHIRP) > threshold)) - 1


def test_motion_below_the_threshold_is_none():
    assert found(np.concatenate([REST, 0.9e-6 * np.sign(CHIRP)])) == []


@pytest.mark.parametrize(("rest", "windows"), [(0.0199, 0), (0.0202, 1)])
def test_window_needs_rest_before(rest, windows):
    """The motion of the wave before it ends in the first sample of the rest."""
    wave = 1e-3 * np.sin(2 * np.pi * 10 * H * np.arange(1, 2001))
    # 1e-4 rad from the wave's end, so that the rest begins with a motion.
    command = np.concatenate([wave, np.full(round(rest / H), 1e-4), 1e-4 + CHIRP])
    # The chirp's first samples are below the threshold and belong to the rest as well.
    below = int(np.argmax(np.abs(CHIRP) > 1e-6))
    shorter = np.delete(command, np.arange(2000, 2000 + below))
    events = found(shorter, TriggerSettings(window_s=0.4))
    assert len(events) == windows


def test_step_begins_in_the_sample_before_it():
    command = np.concatenate([REST, np.full(50, 0.1), np.zeros(5000)])
    [window] = found(command, TriggerSettings(window_s=0.01))
    assert window.telemetry.first_index - 1 == len(REST) - 1
    assert window.command[0] == 0.0
    assert np.all(window.command[1:51] == 0.1)


def test_approach_from_below_leaves_the_motor_on_its_upper_flank():
    assert play_of(CYCLE.samples) == 1.0


def test_without_approach_the_place_in_the_play_is_unknown():
    assert play_of(np.concatenate([REST, CHIRP, REST])) is None


@pytest.mark.parametrize(("share", "play"), [(0.99, None), (1.01, 1.0)])
def test_approach_must_cover_the_widest_play_and_what_friction_holds(share, play):
    depth = share * approach_travel(PARAMETERS)
    approach = np.concatenate([np.linspace(0.0, -depth, 2000), np.linspace(-depth, 0.0, 2000)])
    assert play_of(np.concatenate([REST, approach, REST, CHIRP, REST])) == play


def test_chirp_that_begins_against_the_approach_does_not_undo_it():
    """The samples below the threshold before a window are no motion."""
    command = CYCLE.samples.copy()
    command[CYCLE.start + 1 :] *= -1
    assert play_of(command) == 1.0


def test_jitter_of_the_command_does_not_move_the_start():
    """Rounding, here of 1e-9 rad, against a threshold of 1e-6 rad."""
    jitter = np.random.default_rng(0).uniform(-1e-9, 1e-9, 4 * N)
    starts = [w.telemetry.first_index for w in found(np.tile(CYCLE.samples, 4) + jitter)]
    assert starts == [1 + number * N + last_at_rest(1e-6) for number in range(4)]


@pytest.mark.parametrize("name", ["window_s", "rest_s", "threshold"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_settings_are_refused_by_name(name, value):
    with pytest.raises(ValueError, match=name):
        TriggerSettings(**{name: value})


@pytest.mark.parametrize("changes", [{}, {"BLK": 0.05}, {"tau": 0.004, "BLK": 0.01}, {"GAP": 0.01}])
def test_own_cycle_always_tells_where_in_its_play_the_motor_stands(changes):
    parameters = PARAMETERS.replace(changes)
    cycle = build_cycle(THESIS_CHIRP, H, approach_depth(parameters)).samples
    trigger = WindowTrigger(parameters)
    [window] = windows_in([e for block in blocks(stream(cycle), 100) for e in trigger.feed(block)])
    assert window.play == 1.0


def test_window_is_stamped_by_its_own_blocks_when_the_clock_drifts():
    """A clock half a percent fast is within tolerance, but not forgotten over the approach."""
    drifting = [
        replace(block, stamp_ns=START_NS + round(1.005 * (block.stamp_ns - START_NS)))
        for block in blocks(stream(CYCLE.samples), 100)
    ]
    trigger = WindowTrigger(PARAMETERS)
    [window] = windows_in([event for block in drifting for event in trigger.feed(block)])
    [own] = [
        block
        for block in drifting
        if block.first_index <= window.telemetry.first_index < block.first_index + len(block)
    ]
    offset = window.telemetry.first_index - own.first_index
    assert window.start_ns == own.stamp_ns + offset * PERIOD_NS
