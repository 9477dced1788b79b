# SPDX-License-Identifier: Apache-2.0
"""A window finder turns descriptions and telemetry, in any order, into numbered windows."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.reasons import DescriptionChanged, MalformedBlock, SettingsChanged
from ema_monitor.windows import finder as finder_module
from ema_monitor.windows import trigger as trigger_module
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import Defect, Refusal, TriggerSettings
from ema_monitor.windows.window import Window

from .streams import START_NS, H, blocks, only, sentence, stream

FLAP = ActuatorDescription()
SETTINGS = TriggerSettings(window_s=0.05, rest_s=0.01)
REST = np.zeros(200)
MOTION = 1e-3 * np.sin(2 * np.pi * 40.0 * H * np.arange(1.0, 501.0))
CYCLE = np.concatenate([REST, MOTION, REST])


def cycles(count: int, first_index: int = 1) -> Telemetry:
    return stream(np.tile(CYCLE, count), first_index)


def fed(finder: WindowFinder, telemetry: Telemetry, size: int = 100) -> list[Segment | Defect]:
    return [event for block in blocks(telemetry, size) for event in finder.feed(block)]


def summary(events: list[Segment | Defect]) -> list[tuple[int, int, int, str]]:
    return [
        (item.number, item.window.start_ns, item.window.end_ns, getattr(item.window, "reason", ""))
        for item in only(Segment, events)
    ]


def test_windows_are_numbered_and_early_telemetry_waits_for_the_description():
    finder = WindowFinder(SETTINGS)
    assert fed(finder, cycles(3)) == []
    assert (finder.windows, finder.has_rested) == (0, False)
    segments = finder.describe(FLAP)
    assert (finder.windows, finder.blocks, finder.lost_samples) == (3, 27, 0)
    assert finder.has_rested
    assert all(isinstance(item.window, Window) for item in only(Segment, segments))
    assert summary(segments) == summary(fed(WindowFinder(SETTINGS, FLAP), cycles(3)))
    later = only(Segment, fed(finder, cycles(1, 2701)))
    assert [item.number for item in (*only(Segment, segments), *later)] == [0, 1, 2, 3]


def test_only_the_latest_ten_seconds_wait():
    finder = WindowFinder(SETTINGS)
    # 0.09 s per cycle, 12.6 s in all, in blocks of one cycle: a block begins 10 s before the end.
    fed(finder, cycles(140), 900)
    assert len(only(Segment, finder.describe(FLAP))) == 112


@pytest.mark.parametrize("change", ["description", "settings"])
def test_change_of_the_description_ends_the_open_window(change: str):
    finder = WindowFinder(SETTINGS, FLAP)
    part = blocks(cycles(1), 100)
    for block in part[:5]:
        assert finder.feed(block) == []
    if change == "description":
        [event] = finder.describe(replace(FLAP, serial_number="SIM-0002"))
    else:
        [event] = finder.restart(TriggerSettings(window_s=0.03, rest_s=0.01), SettingsChanged())
    assert isinstance(event, Segment)
    assert isinstance(event.window, Refusal)
    reason = DescriptionChanged() if change == "description" else SettingsChanged()
    assert event.window.cause == reason
    # The window belongs to the unit that was described at its start.
    assert (event.number, event.description) == (0, FLAP)
    [after] = only(Segment, fed(finder, cycles(1, 901)))
    assert after.number == 1
    assert after.description.serial_number == (
        "SIM-0002" if change == "description" else "SIM-0001"
    )
    assert isinstance(after.window, Window)
    assert len(after.window) == (500 if change == "description" else 300)


def test_lost_samples_are_counted_and_refuse_the_window():
    finder = WindowFinder(SETTINGS, FLAP)
    part = blocks(cycles(2), 100)
    events = [
        event for i, block in enumerate(part) if i not in (3, 4) for event in finder.feed(block)
    ]
    first, second = only(Segment, events)
    assert isinstance(first.window, Refusal)
    assert "gap of 200 samples" in first.window.reason
    assert isinstance(second.window, Window)
    assert (finder.lost_samples, finder.windows) == (200, 2)


def test_invalid_block_ends_the_window_or_interrupts_waiting_telemetry():
    finder = WindowFinder(SETTINGS, FLAP)
    part = blocks(cycles(1), 100)
    assert [e for block in part[:5] for e in finder.feed(block)] == []
    [event] = only(Segment, finder.reject(part[5].stamp_ns, "columns differ"))
    assert isinstance(event.window, Refusal)
    assert event.window.reason == "columns differ"
    [outside] = finder.reject(part[6].stamp_ns, "columns differ")
    assert outside == Defect(part[6].stamp_ns, MalformedBlock("columns differ"))
    assert finder.blocks == 7

    finder, telemetry = WindowFinder(SETTINGS), cycles(2)
    half = len(telemetry) // 2
    fed(finder, telemetry.part(0, half))
    assert finder.reject(5, "columns differ") == [Defect(5, MalformedBlock("columns differ"))]
    fed(finder, telemetry.part(half, len(telemetry)))
    # The defect is reported again at its position, between the windows of the two cycles.
    first, defect, second = finder.describe(FLAP)
    assert defect == Defect(5, MalformedBlock("columns differ"))
    assert [item.number for item in only(Segment, [first, second])] == [0, 1]


def test_sample_period_that_contradicts_the_description_is_reported_once():
    finder = WindowFinder(SETTINGS, replace(FLAP, sample_period=2e-4))
    first, *rest = fed(finder, cycles(2))
    assert isinstance(first, Defect)
    assert "0.0002 s" in first.reason
    assert "0.0001 s" in first.reason
    assert [item.number for item in only(Segment, rest)] == [0, 1]


def test_end_of_telemetry_ends_the_window_and_a_new_start_is_not_a_gap():
    finder = WindowFinder(SETTINGS, FLAP)
    fed(finder, cycles(1).part(0, 500))
    [event] = only(Segment, finder.finish())
    assert isinstance(event.window, Refusal)
    assert "the telemetry ends" in event.window.reason
    assert finder.finish() == []
    assert [item.number for item in only(Segment, fed(finder, cycles(1, 5001)))] == [1]
    assert finder.lost_samples == 0


def test_setting_that_the_motion_does_not_satisfy_is_named_after_three_motions():
    finder = WindowFinder(replace(SETTINGS, window_s=0.06), FLAP)
    fed(finder, cycles(2))
    assert finder.obstacle is None
    fed(finder, cycles(2, first_index=2 * len(CYCLE) + 1))
    assert sentence(finder.obstacle) == (
        "window_s = 0.06 s: the longest motion after a rest of 0.01 s lasts 0.05 s"
    )
    finder.restart(SETTINGS, SettingsChanged())
    assert finder.obstacle is None
    fed(finder, cycles(4, first_index=4 * len(CYCLE) + 1))
    assert (finder.windows, finder.obstacle) == (4, None)


def test_command_that_never_rests_is_named_with_the_definition_of_rest():
    finder = WindowFinder(replace(SETTINGS, rest_s=10.0), FLAP)
    fed(finder, cycles(112), size=10_000)
    assert sentence(finder.obstacle) == (
        "rest_s = 10 s, threshold = 1e-06 rad: the command was never at rest in 10 s"
    )
    too_little = WindowFinder(replace(SETTINGS, windows="any_motion"), FLAP)
    fed(too_little, stream(1e-2 * np.tile(CYCLE, 4)))
    assert "the command never travels" in sentence(too_little.obstacle)


def kept_samples(finder: WindowFinder) -> tuple[int, int]:
    """Return how many blocks a finder keeps, and how many samples."""
    kept = finder._trigger._blocks if finder._trigger else finder._undescribed
    return len(kept), sum(len(item) for item in kept if isinstance(item, Telemetry))


@pytest.mark.parametrize("description", [None, FLAP])
def test_kept_telemetry_is_limited_for_any_period(monkeypatch, description):
    for module in (finder_module, trigger_module):
        monkeypatch.setattr(module, "MOST_SAMPLES", 5000)
        monkeypatch.setattr(module, "MOST_BLOCKS", 70)
    finder = WindowFinder(SETTINGS, description)
    # The stamps are equal, so that none is too old: 20,000 samples, in blocks of 100 and of 1.
    telemetry = stream(np.zeros(20_000))
    for block in blocks(telemetry, 100):
        finder.feed(replace(block, stamp_ns=START_NS) if description is None else block)
    count, samples = kept_samples(finder)
    assert count <= 70
    assert samples <= 5000 + 100
    for block in blocks(stream(np.zeros(500), 20_001), 1):
        finder.feed(block)
    assert kept_samples(finder)[0] <= 71
    # Windows are still detected.
    for block in blocks(cycles(2, 20_501), 100):
        finder.feed(block)
    if description is None:
        finder.describe(FLAP)
    assert finder.windows == 2


def test_period_at_which_a_window_would_use_all_memory_is_named():
    finder = WindowFinder(SETTINGS, FLAP)
    block = replace(stream(np.zeros(100)), sample_period=1e-9)
    event = [item for _ in range(3) for item in finder.feed(block)][-1]
    assert isinstance(event, Defect)
    assert "sample_period = 1e-09 s: a window of 0.05 s would have 50,000,000 samples" in (
        event.reason
    )
    assert kept_samples(finder)[0] == 0
    assert len(only(Segment, fed(finder, cycles(1)))) == 1


def test_window_with_too_many_blocks_is_refused_and_the_next_one_accepted(monkeypatch):
    monkeypatch.setattr(trigger_module, "MOST_BLOCKS", 300)
    finder = WindowFinder(SETTINGS, FLAP)
    [*_, reason] = summary(fed(finder, cycles(1), 1)[:1])[0]
    assert "more than 300 blocks" in reason
    assert isinstance(only(Segment, fed(finder, cycles(1, 901)))[0].window, Window)


@pytest.mark.parametrize("first_index", [2**53, 2**63 - 450, 2**63, 2**64 - 900])
def test_window_is_detected_at_any_running_index(first_index: int):
    windows = []
    for index in (first_index, 1):
        [segment] = only(
            Segment, fed(WindowFinder(SETTINGS, FLAP), replace(cycles(1), first_index=index))
        )
        assert isinstance(segment.window, Window)
        windows.append(segment.window.telemetry.first_index - index)
    assert windows[0] == windows[1]


def test_modelled_drive_without_a_command_is_reported():
    whole = cycles(12)
    finder = WindowFinder(SETTINGS, FLAP)
    assert fed(finder, replace(whole, command=np.empty(0))) == []
    assert finder.finish() == []
    assert "the telemetry has no command" in sentence(finder.shortage)
    assert finder.obstacle == finder.shortage
    unknown = WindowFinder(SETTINGS, replace(FLAP, drive="unknown"))
    fed(unknown, replace(whole, command=np.empty(0)))
    assert "command" not in sentence(unknown.obstacle)
