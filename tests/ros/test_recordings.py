# SPDX-License-Identifier: Apache-2.0
"""Records of an unknown drive in a recording equal the live records."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_core.description import ActuatorDescription
from ema_core.telemetry import COLUMNS, Telemetry
from ema_monitor.reason_texts import text_of
from ema_monitor.recordings.finding import read_windows
from ema_monitor.recordings.windows import BagWindows, WindowPlace, WindowsOnDemand
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window

H = 0.01
UNKNOWN = ActuatorDescription(sample_period=H, drive="unknown")
START_NS = 1_700_000_000_000_000_000
SETTINGS = TriggerSettings(record_s=10.0)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return the path of a recording to write."""
    return tmp_path / "flight.mcap"


def motion(seconds: float) -> NDArray[np.float64]:
    return 0.3 * np.sin(2.0 * np.pi * H * np.arange(1.0, round(seconds / H) + 1.0))


def blocks_of(
    position: NDArray[np.float64], size: int, first_index: int = 1, start_ns: int = START_NS
) -> list[Telemetry]:
    """Return blocks whose current is the sample index and whose stamps jitter by up to 0.2 ms."""
    random = np.random.default_rng(1)
    blocks = []
    for start in range(0, len(position), size):
        part, index = position[start : start + size], first_index + start
        stamp_ns = start_ns + index * 10_000_000 + int(random.integers(200_000))
        count = np.arange(index, index + len(part), dtype=float)
        blocks.append(Telemetry(stamp_ns, H, index, part, count, part, np.zeros(len(part))))
    return blocks


def recorded(path: Path, blocks: Sequence[Telemetry]) -> Path:
    with SimulatedActuatorBag(BagWriter(path), UNKNOWN, START_NS) as bag:
        for block in blocks:
            bag.write_block(block, 0.0)
    return path


def live(blocks: Sequence[Telemetry]) -> list[Window]:
    finder = WindowFinder(SETTINGS, UNKNOWN)
    events = [event for block in blocks for event in finder.feed(block)] + finder.finish()
    windows = [event.window for event in events if isinstance(event, Segment)]
    assert all(isinstance(window, Window) for window in windows)
    return [window for window in windows if isinstance(window, Window)]


def assert_same(recording: BagWindows, windows: Sequence[Window]) -> None:
    assert len(recording.usable) == len(windows) == len(recording.windows)
    for window, place, expected in zip(recording.usable, recording.windows, windows, strict=True):
        assert (place.start_ns, place.end_ns) == (expected.start_ns, expected.end_ns)
        assert window.telemetry.stamp_ns == expected.telemetry.stamp_ns
        assert window.telemetry.first_index == expected.telemetry.first_index
        for name in COLUMNS:
            assert np.array_equal(
                getattr(window.telemetry, name), getattr(expected.telemetry, name)
            )


@pytest.mark.parametrize("size", [1, 7, 400])
def test_records_of_a_bag_equal_the_live_records(path: Path, size: int):
    """The bag has long motion, rests, and a motion at its end; blocks are shorter than records."""
    position = np.concatenate(
        [np.zeros(300), motion(33.0), np.zeros(900), motion(4.0), np.zeros(200), motion(3.0)]
    )
    blocks = blocks_of(position, size)
    windows = live(blocks)
    # 20 s without rest, the remaining 13 s, and both motions at the end.
    lengths = [20.0, 13.0 + 0.5 + 0.5, 0.5 + 9.0]
    assert [len(window.telemetry) * H for window in windows] == pytest.approx(lengths, abs=0.6)
    assert_same(read_windows(recorded(path, blocks), SETTINGS), windows)


def test_record_before_a_restart_of_the_index_is_read_from_its_blocks(path: Path):
    """A driver that restarts in the middle of a motion counts from 1 again."""
    before = blocks_of(motion(8.0), 50)
    after = blocks_of(motion(6.0), 50, start_ns=START_NS + 9_000_000_000)
    recording = read_windows(recorded(path, [*before, *after]), SETTINGS)
    assert_same(recording, live([*before, *after]))
    assert [len(window.telemetry) for window in recording.usable] == [800, 600]
    assert any("the sample index went back" in remark for remark in recording.remarks)


def test_pieces_too_short_for_a_record_are_reported(path: Path):
    short = np.concatenate([motion(1.0), np.zeros(700)])
    recording = read_windows(recorded(path, blocks_of(short, 50)), SETTINGS)
    # The first and the last bin, of 0.03 s each, do not count.
    reason = "a record needs 2 s of motion, and the longest piece has 0.92 s"
    assert recording.windows == []
    assert recording.obstacle is not None
    assert text_of(recording.obstacle) == reason
    long = np.concatenate([short, motion(5.0)])
    recording = read_windows(recorded(path.with_name("long.mcap"), blocks_of(long, 50)), SETTINGS)
    assert len(recording.windows) == 1
    assert recording.obstacle is None
    assert f"1 piece of the telemetry ignored: {reason}" in recording.remarks
    assert "1 record" in str(recording)


def test_long_records_stay_in_the_bag(path: Path):
    """One record stays in memory if it exceeds 1 million samples, two if they are shorter."""
    position = np.concatenate([motion(4.0), np.zeros(700), motion(4.0)])
    recording = read_windows(recorded(path, blocks_of(position, 100)), SETTINGS)
    assert len(recording.usable) == 2
    usable = WindowsOnDemand(recording.windows)
    first = usable[0]
    assert usable[1] is usable[1]
    assert usable[0] is first
    long = []
    for window in recording.windows:
        assert isinstance(window.place, WindowPlace)
        long.append(replace(window, place=_LongPlace(window.place)))
    usable = WindowsOnDemand(long)
    first = usable[0]
    assert usable[1] is usable[1]
    assert usable[0] is not first


class _LongPlace(WindowPlace):
    """A window place that claims to have 1.5 million samples."""

    def __init__(self, place: WindowPlace) -> None:
        super().__init__(place.recorded, place.first, place.last, place.offset, 1_500_000)
        object.__setattr__(self, "_place", place)

    def read(self) -> Telemetry:
        return self.__dict__["_place"].read()
