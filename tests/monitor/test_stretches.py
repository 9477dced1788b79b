# SPDX-License-Identifier: Apache-2.0
"""Stretches of ordinary motion: their begin and end, and motion that gives none."""

from itertools import pairwise

import numpy as np
import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.stretches import StretchTrigger
from ema_monitor.windows.trigger import Defect, Refusal
from ema_monitor.windows.window import MIN_TRAVEL, Window

from .motion import FLAP, SETTINGS, H, moved, moves, stretches_of
from .streams import blocks


@pytest.fixture(scope="module")
def motion() -> Telemetry:
    """Return five seconds of moves, with a play of half a milliradian at the user shaft."""
    return moved(moves(5.0), backlash=0.5)


@pytest.fixture(scope="module")
def stretches(motion) -> list[Window]:
    return stretches_of(motion)


def fed(telemetry: Telemetry) -> tuple[StretchTrigger, list[Window | Refusal | Defect]]:
    trigger = StretchTrigger(FLAP.parameters, SETTINGS)
    return trigger, [event for block in blocks(telemetry, 1000) for event in trigger.feed(block)]


def test_stretches_cover_the_motion_and_do_not_overlap(stretches):
    # Nearly all of five seconds: a start waits for a tenth of a second at most.
    assert len(stretches) in (8, 9)
    for before, after in pairwise(stretches):
        assert after.start_ns >= before.end_ns
        assert len(before) == round(0.5 / H)


def test_stretches_do_not_depend_on_the_length_of_the_blocks(motion, stretches):
    expected = [(stretch.start_ns, stretch.end_ns, stretch.play) for stretch in stretches]
    for size in (7, len(motion)):
        assert [(w.start_ns, w.end_ns, w.play) for w in stretches_of(motion, size)] == expected


def test_stretches_begin_where_the_motor_drives_the_shaft(motion, stretches):
    """There the motor is at the end of its play: half its width beyond the shaft."""
    half_width = FLAP.parameters.BLK * (1.0 + 99.0 * 0.5) / 2.0
    # The simulation has the position of the motor, the telemetry only its speed.
    turned = H * np.cumsum(motion.speed)
    shaft = motion.position / FLAP.parameters.tau
    with_play = [stretch for stretch in stretches if stretch.play is not None]
    assert len(with_play) >= len(stretches) - 1
    for stretch in with_play:
        start = stretch.telemetry.first_index - motion.first_index
        play = (turned[start] - shaft[start]) / half_width
        # Speeds at the ends of samples give the angle to some milliradians.
        assert stretch.play == pytest.approx(play, abs=0.1)


def test_rest_gives_no_stretch_and_refuses_none():
    # The step to the first sample is motion; it has ended after a rest.
    trigger, events = fed(moved(np.full(10_000, 0.003)))
    assert events == []
    assert trigger.has_rested


def test_motion_below_the_smallest_travel_is_ignored():
    t = H * np.arange(1, 20_001)
    trigger, events = fed(moved(0.4 * MIN_TRAVEL * np.sin(2.0 * np.pi * 3.0 * t)))
    assert events == []
    assert trigger.passed_over >= 3


def test_gap_ends_a_stretch_as_a_defect_and_not_as_a_refusal(motion):
    parts = blocks(motion, 1000)
    trigger = StretchTrigger(FLAP.parameters, SETTINGS)
    events = [event for block in [*parts[:3], *parts[4:]] for event in trigger.feed(block)]
    [gap] = [event for event in events if isinstance(event, Defect)]
    assert "gap of 1000 samples" in gap.reason
    assert not any(isinstance(event, Refusal) for event in events)
    assert trigger.finish() == []


def test_finder_marks_stretches(motion):
    finder = WindowFinder(SETTINGS, FLAP)
    segments = [event for block in blocks(motion, 1000) for event in finder.feed(block)]
    assert segments
    assert all(isinstance(segment, Segment) and segment.is_stretch for segment in segments)
    assert finder.finish() == []
