# SPDX-License-Identifier: Apache-2.0
"""Windows are detected by the command; a defect of a stream does not outlast its window."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP, approach_depth, approach_travel, build_cycle
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import COLUMNS, Telemetry
from ema_monitor.reasons import SettingsChanged
from ema_monitor.windows.trigger import Defect, Refusal, TriggerSettings, WindowTrigger
from ema_monitor.windows.window import Window

from .streams import PERIOD_NS, START_NS, H, blocks, only, stream

PARAMETERS = ActuatorParameters()
CYCLE = build_cycle(THESIS_CHIRP, H)
N = len(CYCLE.samples)
REST = np.zeros(1000)
CHIRP = THESIS_CHIRP.sample(H)


def last_at_rest(threshold):
    """Return the sample of the cycle, from 0, before the chirp passes the threshold."""
    chirp = CYCLE.samples[CYCLE.start :]
    return CYCLE.start + int(np.argmax(np.abs(chirp) > threshold)) - 1


def feed(parts, trigger=None):
    trigger = trigger or WindowTrigger(PARAMETERS)
    return [event for block in parts for event in trigger.feed(block)]


def found(command, settings=None, parameters=PARAMETERS):
    parts = blocks(stream(command), 100)
    return only(Window, feed(parts, WindowTrigger(parameters, settings)))


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 7, 5001, 2 * N])
def test_windows_are_at_the_same_samples_for_any_blocks(size):
    telemetry = stream(np.tile(CYCLE.samples, 2), first_index=41)
    trigger = WindowTrigger(PARAMETERS)
    windows = only(Window, feed(blocks(telemetry, size), trigger))
    assert len(windows) == 2
    for number, window in enumerate(windows):
        start = number * N + last_at_rest(1e-6)
        assert len(window) == 5000
        assert window.telemetry.first_index == 41 + start
        # Sample 41 + start ends 41 + start periods of 100 us after the time of index 0.
        assert window.start_ns == START_NS + (41 + start) * PERIOD_NS
        assert window.end_ns == window.start_ns + 500_000_000
        for name in COLUMNS:
            expected = getattr(telemetry, name)[start : start + 5001]
            assert np.array_equal(getattr(window.telemetry, name), expected)
        assert window.play == 1.0
    assert trigger.finish() == []


def test_approach_is_ignored():
    """Its motion ends before a window is full; its duration is remembered."""
    trigger = WindowTrigger(PARAMETERS)
    assert trigger.feed(stream(CYCLE.samples[: CYCLE.start])) == []
    # 0.4 s up from -2 mrad, measured to some samples.
    assert trigger.longest_motion_s == pytest.approx(0.4, abs=2e-3)
    assert trigger.finish() == []


def test_one_way_motion_of_any_length_is_ignored():
    """An approach longer than a window does not show faults that need a reversal."""
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


@pytest.mark.parametrize(("rest", "windows"), [(0.0199, 0), (0.0202, 1)])
def test_window_needs_rest_before_it(rest, windows):
    """The motion of the previous wave ends in the first sample of the rest."""
    wave = 1e-3 * np.sin(2 * np.pi * 10 * H * np.arange(1, 2001))
    # 1e-4 rad from the end of the wave, so that the rest begins with a motion.
    command = np.concatenate([wave, np.full(round(rest / H), 1e-4), 1e-4 + CHIRP])
    # The first samples of the chirp are below the threshold and belong to the rest as well.
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


def approached(depth):
    """Return a command that goes down by a depth and up again before the chirp."""
    approach = np.concatenate([np.linspace(0.0, -depth, 2000), np.linspace(-depth, 0.0, 2000)])
    return np.concatenate([REST, approach, REST, CHIRP, REST])


@pytest.mark.parametrize(
    ("command", "play"),
    [
        (np.concatenate([REST, CHIRP, REST]), None),
        # The approach must cover the widest play and the reach of friction.
        (approached(0.99 * approach_travel(PARAMETERS)), None),
        (approached(1.01 * approach_travel(PARAMETERS)), 1.0),
        # A chirp that begins against the approach: samples below the threshold are not motion.
        (np.concatenate([CYCLE.samples[: CYCLE.start], -CYCLE.samples[CYCLE.start :]]), 1.0),
    ],
    ids=["no approach", "short", "long", "against"],
)
def test_position_in_the_play_is_known_after_an_approach(command, play):
    [window] = found(command)
    assert window.play == play


def test_jitter_of_the_command_does_not_move_the_start():
    """Rounding of 1e-9 rad is far below the threshold of 1e-6 rad."""
    jitter = np.random.default_rng(0).uniform(-1e-9, 1e-9, 2 * N)
    starts = [w.telemetry.first_index for w in found(np.tile(CYCLE.samples, 2) + jitter)]
    assert starts == [1 + number * N + last_at_rest(1e-6) for number in range(2)]


@pytest.mark.parametrize("changes", [{}, {"BLK": 0.05}, {"tau": 0.004, "BLK": 0.01}, {"GAP": 0.01}])
def test_own_cycle_always_determines_the_position_of_the_motor_in_its_play(changes):
    parameters = PARAMETERS.replace(changes)
    cycle = build_cycle(THESIS_CHIRP, H, approach_depth(parameters)).samples
    [window] = found(cycle, parameters=parameters)
    assert window.play == 1.0


def test_window_has_the_stamp_of_its_own_blocks_if_the_clock_drifts():
    """A clock fast by half a per cent is within tolerance, but matters over the approach."""
    drifting = [
        replace(block, stamp_ns=START_NS + round(1.005 * (block.stamp_ns - START_NS)))
        for block in blocks(stream(CYCLE.samples), 100)
    ]
    [window] = only(Window, feed(drifting))
    [first] = [
        block
        for block in drifting
        if block.first_index <= window.telemetry.first_index < block.first_index + len(block)
    ]
    offset = window.telemetry.first_index - first.first_index
    assert window.start_ns == first.stamp_ns + offset * PERIOD_NS


STARTS = [number * N + 8014 for number in (0, 1)]
"""Running index of each window's first sample in two cycles counted from 1."""

# Blocks of 100 samples: block 22 has indices 2201 to 2300, in the hold before the first approach;
# block 90 has 9001 to 9100, in the first window.
PLACES = {"at rest": 22, "in a window": 90}


@pytest.fixture
def two_cycles():
    return blocks(stream(np.tile(CYCLE.samples, 2)), 100)


def stamp(index):
    return START_NS + index * PERIOD_NS


def gap(parts, number):
    first = 100 * number + 1
    reason = f"gap of 300 samples: index {first + 300} follows {first - 1}"
    return [*parts[:number], *parts[number + 3 :]], reason, 0


def no_numbers(column, value):
    def spoiled(parts, number):
        row = getattr(parts[number], column).copy()
        row[[37, 62]] = value
        reason = f"{column} is {value} at index {100 * number + 38} (2 such samples in its block)"
        changed = replace(parts[number], **{column: row})
        return [*parts[:number], changed, *parts[number + 1 :]], reason, 0

    return spoiled


def index_goes_back(parts, number):
    """Return the parts with an index that restarts, while the time continues."""
    lost = 100 * number
    after = [replace(block, first_index=block.first_index - lost) for block in parts[number:]]
    return [*parts[:number], *after], f"the sample index went back from {lost} to 1", lost


def clock_is_set_back(parts, number):
    """The clock is set back by 2 s, from the last sample of the previous block plus 10 ms on."""
    after = [replace(block, stamp_ns=block.stamp_ns - 2 * 10**9) for block in parts[number:]]
    reason = f"time ran backwards by 1.99 s at index {100 * number + 1}"
    return [*parts[:number], *after], reason, 0


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    "defect",
    [
        gap,
        index_goes_back,
        clock_is_set_back,
        *(no_numbers(column, math.nan) for column in COLUMNS),
        no_numbers("current", -math.inf),
    ],
)
def test_defect_is_named_and_does_not_outlast_its_window(two_cycles, place, defect):
    """All windows whose approach comes after the defect are detected."""
    parts, reason, lost = defect(two_cycles, PLACES[place])
    first, *later = feed(parts)
    [named] = only(Refusal, [first]) if place == "in a window" else only(Defect, [first])
    assert reason in named.reason
    if isinstance(named, Refusal):
        # Up to the last sample before the defect.
        assert (named.start_ns, named.end_ns) == (stamp(STARTS[0]), stamp(100 * PLACES[place]))
    windows = only(Window, later)
    starts = STARTS[1:] if place == "in a window" else STARTS
    assert [window.telemetry.first_index + lost for window in windows] == starts
    assert {window.play for window in windows} == {1.0}


@pytest.mark.parametrize("place", PLACES)
def test_change_of_the_sample_period_is_named(two_cycles, place):
    number = PLACES[place]
    changed = stream(np.repeat(CYCLE.samples, 2), first_index=100 * number + 1)
    faster = replace(changed, sample_period=H / 2)
    event, *later = feed([*two_cycles[:number], faster])
    [named] = only(Refusal, [event]) if place == "in a window" else only(Defect, [event])
    assert named.reason == "the sample period changed from 0.0001 s to 5e-05 s"
    [window] = only(Window, later)
    assert len(window) == 10_000
    assert window.sample_period == H / 2


@pytest.mark.parametrize(("share", "accepted"), [(1.005, True), (0.98, False), (1.05, False)])
def test_stamps_at_another_rate_are_named(two_cycles, share, accepted):
    """The deviation is detected over a window; 1 % is tolerated for differing clocks."""
    events = feed(
        replace(block, stamp_ns=START_NS + round((block.stamp_ns - START_NS) * share))
        for block in two_cycles
    )
    assert len(events) == 2
    if accepted:
        only(Window, events)
    else:
        printed = f"the stamps give one sample every {share * H:.4g} s, the blocks 0.0001 s"
        assert [refusal.reason for refusal in only(Refusal, events)] == [printed] * 2


def test_end_of_the_telemetry_in_a_window_is_named(two_cycles):
    trigger = WindowTrigger(PARAMETERS)
    # Block 99 ends with index 10000.
    assert feed(two_cycles[:100], trigger) == []
    [refusal] = only(Refusal, trigger.finish())
    assert (refusal.start_ns, refusal.end_ns) == (stamp(STARTS[0]), stamp(10_000))
    assert refusal.reason == "the telemetry ends 0.199 s into the window of 0.5 s"


def test_interrupted_stream_refuses_the_open_window(two_cycles):
    """Only the receiver knows of the interruption, for example by a different source."""
    trigger, why = WindowTrigger(PARAMETERS), SettingsChanged()
    feed(two_cycles[:22], trigger)
    assert trigger.interrupt(stamp(2200), why) == Defect(stamp(2200), why)
    assert feed(two_cycles[22:90], trigger) == []
    refusal = trigger.interrupt(stamp(9050), why)
    assert refusal == Refusal(stamp(STARTS[0]), stamp(9000), why)
    assert trigger.finish() == []


@pytest.mark.parametrize(
    ("lost", "plays"),
    [
        # Indices 8001 to 8100, with the start at 8014: the chirp has no rest to start from.
        (80, [1.0]),
        # 7501 to 7600, between approach and chirp: the motor may have moved in the meantime.
        (75, [None, 1.0]),
    ],
)
def test_rest_and_approach_before_a_defect_do_not_count(two_cycles, lost, plays):
    events = feed([*two_cycles[:lost], *two_cycles[lost + 1 :]])
    assert len(only(Defect, events[:1])) == 1
    windows = only(Window, events[1:])
    assert [window.play for window in windows] == plays
    assert windows[-1].telemetry.first_index == STARTS[1]


@pytest.mark.parametrize(
    ("value", "expected"), [(math.nan, "finite numbers"), (1e300, "numbers below 1e[+]30")]
)
def test_unusable_samples_are_named_at_any_index(value: float, expected: str):
    """An index of 64 bits plus one exceeds the integers of numpy."""
    columns = np.zeros((4, 100))
    columns[3, 7] = value
    block = Telemetry(10**9, 1e-4, 2**64 - 200, *columns)
    [defect] = only(Defect, WindowTrigger(PARAMETERS).feed(block))
    assert re.search(f"speed is .* at index {2**64 - 193} .*: expected {expected}", defect.reason)
