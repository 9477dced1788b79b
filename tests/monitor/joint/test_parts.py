# SPDX-License-Identifier: Apache-2.0
"""Figures of the parts of a record, by direction, distinguish states."""

import numpy as np
import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.joint.parts import mean_of, parts_of
from ema_monitor.joint.signals import Preparation

H, SPEED = 0.02, 8.0
PREPARATION = Preparation(cutoff_hz=3.0, lag_s=0.0, usual_speed=SPEED)


def strokes(cycles, *, ripple=0.0, has_command=True, seconds=4.0):
    """Return a record of strokes back and forth at one speed; the effort is larger forwards."""
    count = round(seconds / H)
    one_cycle = np.concatenate([np.full(count, SPEED), np.full(count, -SPEED)])
    way = np.sign(np.tile(one_cycle, cycles))
    position = np.cumsum(np.tile(one_cycle, cycles)) * H
    effort = np.where(way > 0.0, 1.5, -1.0) + ripple * way * np.cos(2.0 * position)
    command = position + 0.1 * way if has_command else np.empty(0)
    return Telemetry(0, H, 0, command, effort, position, np.empty(0))


@pytest.mark.parametrize(("cycles", "expected"), [(1, 1), (3, 3), (12, 5)])
def test_parts_are_complete_cycles(cycles, expected):
    """Each part has both directions, with the same effort in all parts."""
    parts = parts_of(strokes(cycles), PREPARATION)
    assert len(parts) == expected
    for part in parts:
        # Three samples at a reversal are smoothed over both directions.
        assert part["effort_forward"] == pytest.approx(1.5, abs=0.02)
        assert part["effort_backward"] == pytest.approx(1.0, abs=0.02)
    assert set(mean_of(parts)) == set(parts[0])


def test_ripple_of_an_order_raises_only_the_figure_of_this_order():
    even, rippled = (mean_of(parts_of(strokes(5, ripple=a), PREPARATION)) for a in (0.0, 0.2))
    # Half of the amplitude is in the positive order.
    assert np.exp(rippled["effort_ripple_2_forward"]) == pytest.approx(0.1, rel=0.05)
    assert rippled["effort_ripple_2_forward"] > rippled["effort_ripple_1_forward"] + 2.0
    assert even["effort_ripple_2_forward"] < rippled["effort_ripple_2_forward"] - 2.0


def test_figures_that_a_record_does_not_show_are_missing():
    [part] = parts_of(strokes(1, has_command=False), PREPARATION)
    assert not any(name.startswith("error") for name in part)
    [short] = parts_of(strokes(1, seconds=1.0), PREPARATION)  # 8 rad are less than two turns
    assert not any("ripple" in name for name in short)
    rest = np.zeros(200)
    still = Telemetry(0, H, 0, rest, rest, rest, np.empty(0))
    assert parts_of(still, PREPARATION) == ()
    assert mean_of(()) == {}
