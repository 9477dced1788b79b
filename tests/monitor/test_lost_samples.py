# SPDX-License-Identifier: Apache-2.0
"""Records bridge short gaps, and leave the surroundings of longer ones out of the fit."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ema_core.telemetry import Telemetry, bridged, join, lost_between
from ema_monitor.joint.signals import Preparation, block_means, filtered
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import Defect, TriggerSettings
from ema_monitor.windows.window import Window

from .test_records import START_NS, UNKNOWN, H, rest, sine, telemetry


def pieces(whole: Telemetry, lost: NDArray[np.bool_]) -> list[Telemetry]:
    """Return the samples that were not lost, with a block for each run."""
    kept = np.flatnonzero(~lost)
    runs = np.split(kept, np.flatnonzero(np.diff(kept) > 1) + 1)
    return [whole.part(int(run[0]), int(run[-1]) + 1) for run in runs]


def found_in(blocks: list[Telemetry]) -> list[Segment | Defect]:
    finder = WindowFinder(TriggerSettings(), UNKNOWN)
    events = [event for block in blocks for event in finder.feed(block)]
    return events + finder.finish()


def with_effort(position: NDArray[np.float64]) -> Telemetry:
    speed = np.gradient(position, H)
    effort = np.sign(speed) + 0.3 * speed
    return replace(telemetry(position), current=effort, speed=np.empty(0))


@pytest.mark.parametrize("share", [0.001, 0.005, 0.02, 0.05])
def test_lost_samples_are_bridged_and_flagged(share: float):
    whole = telemetry(np.concatenate([rest(1.0), sine(20.0), rest(1.0)]))
    lost = np.random.default_rng(0).random(len(whole)) < share
    lost[[0, -1]] = False
    [segment] = found_in(pieces(whole, lost))
    assert isinstance(segment, Segment)
    assert isinstance(segment.window, Window)
    record = segment.window.telemetry
    begin = record.first_index - 1
    chosen = slice(begin, begin + len(record))
    np.testing.assert_array_equal(record.interpolated, lost[chosen])
    # On a chord of at most 60 ms of a sine of 1 Hz.
    np.testing.assert_allclose(record.position, whole.position[chosen], atol=0.3 * 0.006)
    measured = ~lost[chosen]
    np.testing.assert_array_equal(record.position[measured], whole.position[chosen][measured])


def test_interpolated_steps_do_not_count_as_resolution_of_the_sensor():
    """Otherwise, a joint whose sensor toggles between two values would never count as resting."""
    step = 2e-3
    toggling = step * (np.arange(600) % 7 == 0)
    position = np.round(np.concatenate([sine(6.0), toggling, sine(6.0)]) / step) * step
    whole = telemetry(position)
    lost = np.random.default_rng(1).random(len(whole)) < 0.05
    lost[[0, -1]] = False
    assert len(found_in(pieces(whole, lost))) == len(found_in([whole])) == 2


def test_stamps_that_contradict_the_gap_prevent_bridging():
    whole = telemetry(sine(10.0))
    first, second = whole.part(0, 400), whole.part(402, 1000)
    assert lost_between(first, second) is not None
    for shift_ns in (-1_000_000_000, 1_000_000_000, 86_400_000_000_000):
        assert lost_between(first, replace(second, stamp_ns=second.stamp_ns + shift_ns)) is None
    assert lost_between(first, whole.part(400, 500)) is None
    assert lost_between(first, replace(second, speed=np.empty(0))) is None


def test_joined_blocks_keep_their_interpolation_flags():
    whole = telemetry(sine(3.0))
    lost = np.zeros(len(whole), dtype=bool)
    lost[[50, 51, 120]] = True
    joined = join(list(bridged(pieces(whole, lost))))
    assert len(joined) == len(whole)
    np.testing.assert_array_equal(joined.part(40, 130).interpolated, lost[40:130])
    assert joined.stamp_ns == START_NS + round(H * 1e9)


def test_rows_around_a_gap_longer_than_the_filter_are_left_out():
    whole = with_effort(sine(20.0))
    preparation = Preparation(cutoff_hz=2.5, lag_s=0.0, usual_speed=2.0)
    lost = np.zeros(len(whole), dtype=bool)
    lost[400:440] = True  # 0.4 s: the filter has a standard deviation of 0.053 s
    lost[900:902] = True
    spoilt = replace(whole, current=np.where(lost, 100.0, whole.current), interpolated=lost)
    rows, intact, filled = (
        filtered(block_means(variant, UNKNOWN, 2.5), preparation)
        for variant in (spoilt, whole, replace(spoilt, interpolated=np.zeros(0, dtype=bool)))
    )
    assert 0.9 * len(intact) < len(rows) < len(intact)
    usual = np.max(intact.effort)
    assert np.max(filled.effort) > 10.0 * usual
    # The surroundings of the long gap are left out, and the short gap is used.
    assert np.sum(rows.effort > 2.0 * usual) in (2, 3, 4)
