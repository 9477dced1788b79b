"""What is wrong with a stream is named with its value, and does not outlast it."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import COLUMNS, Telemetry
from ema_monitor.windows.trigger import Defect, Refusal, WindowTrigger

from .streams import START_NS, H, blocks, defects_in, refusals_in, stream, windows_in

CYCLE = build_cycle(THESIS_CHIRP, H)
N = len(CYCLE.samples)
STARTS = [number * N + 8014 for number in (0, 1)]
"""Running index of each window's first sample in two cycles counted from 1."""

# Blocks of 100 samples: block 22 holds indices 2201 to 2300, in the hold before the first approach;
# block 90 holds 9001 to 9100, in the first window.
PLACES = {"at rest": 22, "in a window": 90}


@pytest.fixture
def two_cycles():
    return list(blocks(stream(np.tile(CYCLE.samples, 2)), 100))


def feed(stream_of_blocks):
    trigger = WindowTrigger(ActuatorParameters())
    return [event for block in stream_of_blocks for event in trigger.feed(block)]


def stamp(index):
    return START_NS + index * 100_000


def check(events, place, reason, shift=0):
    """One event with the reason, and after it every window that can still be found.

    The approach of each window found comes after the defect; `shift` is what the running index
    has lost by then.
    """
    if place == "in a window":
        [refusal] = refusals_in(events[:1])
        assert reason in refusal.reason
        assert refusal.start_ns == stamp(STARTS[0])
        # The last sample before the defect.
        assert refusal.end_ns == stamp(100 * PLACES[place])
        starts = STARTS[1:]
    else:
        [defect] = defects_in(events[:1])
        assert reason in defect.reason
        starts = STARTS
    windows = windows_in(events[1:])
    assert [window.telemetry.first_index for window in windows] == [s - shift for s in starts]
    assert [window.play for window in windows] == [1.0] * len(starts)


@pytest.mark.parametrize("place", PLACES)
def test_gap_is_named(two_cycles, place):
    number = PLACES[place]
    del two_cycles[number : number + 3]
    first = 100 * number + 1
    reason = f"gap of 300 samples: index {first + 300} follows {first - 1}"
    check(feed(two_cycles), place, reason)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("column", COLUMNS)
@pytest.mark.parametrize("value", [float("nan"), float("-inf")])
def test_number_that_is_none_is_named(two_cycles, place, column, value):
    number = PLACES[place]
    spoiled = getattr(two_cycles[number], column).copy()
    spoiled[[37, 62]] = value
    two_cycles[number] = replace(two_cycles[number], **{column: spoiled})
    reason = f"{column} is {value} at index {100 * number + 38} (2 such samples in its block)"
    check(feed(two_cycles), place, reason)


@pytest.mark.parametrize("place", PLACES)
def test_index_that_goes_back_is_named(two_cycles, place):
    """A source that starts to count anew, with its time going on."""
    number = PLACES[place]
    two_cycles[number:] = [
        replace(block, first_index=block.first_index - 100 * number)
        for block in two_cycles[number:]
    ]
    reason = f"the sample index went back from {100 * number} to 1"
    check(feed(two_cycles), place, reason, shift=100 * number)


@pytest.mark.parametrize("place", PLACES)
def test_time_that_runs_backwards_is_named(two_cycles, place):
    """A clock that is set back by 2 s."""
    number = PLACES[place]
    two_cycles[number:] = [
        replace(block, stamp_ns=block.stamp_ns - 2_000_000_000) for block in two_cycles[number:]
    ]
    # From the first sample of the last block to that of this one: 2 s less 10 ms.
    reason = f"time ran backwards by 1.99 s at index {100 * number + 1}"
    check(feed(two_cycles), place, reason)


@pytest.mark.parametrize("place", PLACES)
def test_change_of_the_sample_period_is_named(two_cycles, place):
    number = PLACES[place]
    changed = stream(np.repeat(CYCLE.samples, 2), first_index=100 * number + 1)
    faster = replace(changed, sample_period=H / 2)
    event, *others = feed([*two_cycles[:number], faster])
    [named] = refusals_in([event]) if place == "in a window" else defects_in([event])
    assert named.reason == "the sample period changed from 0.0001 s to 5e-05 s"
    [window] = windows_in(others)
    assert len(window) == 10_000
    assert window.sample_period == H / 2


@pytest.mark.parametrize(("share", "accepted"), [(1.005, True), (0.98, False), (1.05, False)])
def test_stamps_at_another_rate_are_named(two_cycles, share, accepted):
    """They show over a window; 1 % is left to clocks that differ."""
    events = feed(
        replace(block, stamp_ns=START_NS + round((block.stamp_ns - START_NS) * share))
        for block in two_cycles
    )
    assert len(events) == 2
    if accepted:
        windows_in(events)
    else:
        said = f"the stamps give one sample every {share * H:.4g} s, the blocks 0.0001 s"
        assert [refusal.reason for refusal in refusals_in(events)] == [said] * 2


def test_end_of_the_telemetry_in_a_window_is_named(two_cycles):
    trigger = WindowTrigger(ActuatorParameters())
    # Block 99 ends with index 10000.
    assert [event for block in two_cycles[:100] for event in trigger.feed(block)] == []
    [refusal] = trigger.finish()
    assert (refusal.start_ns, refusal.end_ns) == (stamp(STARTS[0]), stamp(10_000))
    assert refusal.reason == "the telemetry ends 0.199 s into the window of 0.5 s"


def test_broken_stream_refuses_the_window_that_is_open(two_cycles):
    """What only the receiver knows, as that another source took over."""
    trigger = WindowTrigger(ActuatorParameters())
    for block in two_cycles[:22]:
        trigger.feed(block)
    assert trigger.interrupt(stamp(2200), "why") == Defect(stamp(2200), "why")
    for block in two_cycles[22:90]:
        assert trigger.feed(block) == []
    refusal = trigger.interrupt(stamp(9050), "why")
    assert refusal == Refusal(stamp(STARTS[0]), stamp(9000), "why")
    assert trigger.finish() == []


def test_after_a_defect_there_must_be_rest_again(two_cycles):
    """The rest before the gap does not count: in the chirp there is no start to be found."""
    # Lost: indices 8001 to 8100, with the start at 8014.
    events = feed([*two_cycles[:80], *two_cycles[81:]])
    assert len(defects_in(events[:1])) == 1
    [window] = windows_in(events[1:])
    assert window.telemetry.first_index == STARTS[1]


def test_approach_before_a_defect_does_not_count(two_cycles):
    """The motor may have moved meanwhile."""
    # Lost: indices 7501 to 7600, in the rest between approach and chirp.
    events = feed([*two_cycles[:75], *two_cycles[76:]])
    assert len(defects_in(events[:1])) == 1
    assert [window.play for window in windows_in(events[1:])] == [None, 1.0]


@pytest.mark.parametrize(
    ("value", "expected"), [(math.nan, "finite numbers"), (1e300, "numbers below 1e[+]30")]
)
def test_samples_of_no_use_are_named_at_any_index(value: float, expected: str):
    """An index of 64 bits plus one of numpy is beyond what numpy adds."""
    columns = np.zeros((4, 100))
    columns[3, 7] = value
    block = Telemetry(10**9, 1e-4, 2**64 - 200, *columns)
    [defect] = defects_in(WindowTrigger(ActuatorParameters()).feed(block))
    assert re.search(f"speed is .* at index {2**64 - 193} .*: expected {expected}", defect.reason)
