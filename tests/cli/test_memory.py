# SPDX-License-Identifier: Apache-2.0
"""Memory does not grow with the length of a bag, because telemetry is read on demand."""

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ema_cli.bags.reading import ReadingOptions, read_windows
from ema_cli.commands.plot import draw_telemetry
from ema_cli.figures.telemetry import BINS, Outline
from ema_core.description import ActuatorDescription
from ema_core.telemetry import COLUMNS, Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.recordings.windows import RecordedWindow, WindowsOnDemand
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import Refusal, TriggerSettings
from ema_monitor.windows.window import Window

from .conftest import repeated

OPTIONS = ReadingOptions()
SHORT, LONG = 4, 16


def peak_bytes(action: Callable[[], Any]) -> int:
    tracemalloc.start()
    try:
        action()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.fixture
def bags(record, faulty_blocks, tmp_path: Path) -> list[Path]:
    """Return a short bag and a bag longer than the look-back of a trigger."""
    paths = []
    for cycles in (SHORT, LONG):
        path = tmp_path / f"{cycles}.mcap"
        record(repeated(faulty_blocks, cycles)).rename(path)
        paths.append(path)
    return paths


def added_bytes(blocks: list[Telemetry]) -> int:
    """Return how many more bytes of telemetry the long bag has than the short one."""
    samples = (LONG - SHORT) * sum(map(len, blocks))
    return samples * len(COLUMNS) * 8


@pytest.mark.long
@pytest.mark.parametrize("sink", [None, Outline], ids=["windows", "outline"])
def test_reading_a_longer_bag_takes_no_more_memory(bags, faulty_blocks, monkeypatch, sink):
    # The look-back of the trigger is constant, but as long as these bags.
    monkeypatch.setattr("ema_monitor.windows.trigger.LOOKBACK_S", 0.5)

    def read(path: Path) -> None:
        recording = read_windows(path, OPTIONS, sink().add if sink else None)
        assert recording.samples == recording.blocks * 100

    read(bags[0])  # Modules and caches are loaded at first use.
    short, long = (peak_bytes(lambda p=path: read(p)) for path in bags)
    assert long - short < 0.05 * added_bytes(faulty_blocks)


@pytest.mark.long
def test_calibrating_on_more_windows_takes_no_more_memory(bags, monkeypatch):
    monkeypatch.setattr("ema_monitor.recordings.windows._KEPT_WINDOWS", 2)
    recording = read_windows(bags[1], OPTIONS)
    assert len(recording.windows) == LONG
    unit = ActuatorDescription()

    def fit(windows: list[RecordedWindow]) -> Calibration:
        return calibrate_model(WindowsOnDemand(windows), unit)

    fit(recording.windows[:SHORT])
    short, long = (peak_bytes(lambda n=n: fit(recording.windows[:n])) for n in (SHORT, LONG))
    one_window = recording.windows[0].window
    assert isinstance(one_window, Window)
    # The longer bag has twelve more windows, yet memory grows by less than one; noise is 40 kB.
    assert long - short < sum(getattr(one_window.telemetry, name).nbytes for name in COLUMNS)


def test_window_read_again_equals_the_detected_one(record, faulty_blocks, spoiled):
    blocks = repeated(faulty_blocks, 3)
    broken = len(faulty_blocks) + 100
    blocks[broken] = spoiled(blocks[broken], "current", 7, np.nan)
    # Block ends differ from window ends, and stamps drift.
    blocks = [
        replace(part, stamp_ns=part.stamp_ns + 13 * number)
        for number, block in enumerate(blocks)
        for part in (block.part(0, 37), block.part(37, 100))
    ]
    watch = WindowFinder(TriggerSettings(), ActuatorDescription())
    live = [event for block in blocks for event in watch.feed(block) if isinstance(event, Segment)]
    again = read_windows(record(blocks), OPTIONS).windows
    assert len(live) == len(again) == 3
    for detected, reread in zip(live, again, strict=True):
        assert (detected.number, detected.description) == (reread.number, reread.description)
        if isinstance(detected.window, Refusal):
            # NaN differs from itself.
            assert repr(detected.window) == repr(reread.window)
            continue
        assert isinstance(reread.window, Window)
        a, b = detected.window.telemetry, reread.window.telemetry
        assert detected.window.play == reread.window.play
        assert (a.stamp_ns, a.first_index) == (b.stamp_ns, b.first_index)
        for name in COLUMNS:
            assert getattr(a, name).tobytes() == getattr(b, name).tobytes()


def test_outline_of_few_samples_breaks_at_missing_ones(faulty_blocks):
    outline = Outline()
    for number, block in enumerate(faulty_blocks[:60]):
        if number != 30:
            outline.add(block)
    times, values = outline.lines("current", faulty_blocks[0].stamp_ns)
    assert np.all(np.isnan(values[(times > 0.3005) & (times < 0.3095)]))
    assert not np.any(np.isnan(values[(times >= 0.0) & (times < 0.299)]))


def test_outline_of_many_samples_stays_small_and_keeps_the_extremes(faulty_blocks):
    outline = Outline()
    blocks = repeated(faulty_blocks, 6)
    for block in blocks:
        outline.add(block)
    times, values = outline.lines("speed", blocks[0].stamp_ns)
    assert len(times) == 2 * BINS
    assert np.nanmax(values) == max(np.max(block.speed) for block in blocks)
    end = (blocks[-1].stamps_ns[-1] - blocks[0].stamp_ns) * 1e-9
    assert times[np.isfinite(values)][-1] == pytest.approx(end, abs=0.01)


@pytest.mark.parametrize("samples", [2 * BINS, 2 * BINS + 1, 4 * BINS - 1, 4 * BINS, 4 * BINS + 1])
def test_outline_has_room_for_the_last_sample(samples: int):
    rising = np.arange(samples, dtype=np.float64)
    outline = Outline()
    outline.add(Telemetry(100_000, 1e-4, 1, rising, rising, rising, rising))
    _, values = outline.lines("speed", 100_000)
    assert (np.nanmin(values), np.nanmax(values)) == (0.0, samples - 1.0)


@pytest.mark.long
def test_picture_of_more_windows_draws_no_more_points(bags):
    drawn = []
    for path in bags:
        outline = Outline()
        figure = draw_telemetry(read_windows(path, OPTIONS, outline.add), outline)
        drawn.append([len(axes.get_children()) for axes in figure.axes])
    assert drawn[0] == drawn[1]
