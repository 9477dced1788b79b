# SPDX-License-Identifier: Apache-2.0
"""A late effort is measured and corrected, and never mistaken for different friction."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.joint.lag import EffortLag, aligned, effort_lag, with_shift
from ema_monitor.joint.signals import Preparation, block_means

from .plant import Joint, Sensors, described, telemetry_of, tones

PREPARATION = Preparation(cutoff_hz=2.0, lag_s=0.0, usual_speed=3.0)
H = 1e-3


def late(telemetry: Telemetry, lag_s: float) -> Telemetry:
    t = telemetry.sample_period * np.arange(len(telemetry))
    return replace(telemetry, current=np.interp(t - lag_s, t, telemetry.current))


def record(**changes: float) -> Telemetry:
    return telemetry_of(Joint(**changes), tones(30.0), Sensors())


@pytest.mark.parametrize("lag_s", [-0.02, 0.005, 0.05, 0.1])
def test_lag_of_the_effort_is_measured_for_any_friction(lag_s: float):
    joints = [{}, {"coulomb": 1.5 * Joint().coulomb}, {"viscous": 2.0 * Joint().viscous}]
    for changes in joints:
        base, measured = (
            effort_lag(block_means(telemetry, described(), PREPARATION.cutoff_hz), PREPARATION)
            for telemetry in (record(**changes), late(record(**changes), lag_s))
        )
        assert measured.lag_s - base.lag_s == pytest.approx(lag_s, abs=1e-3)
        assert 0.0 < measured.sigma < 5e-3


def test_only_a_significant_lag_shifts_the_effort():
    healthy = [EffortLag(0.010 + 0.001 * i, 1e-3) for i in range(-2, 3)]
    assert with_shift(EffortLag(0.014, 1e-3), healthy, 2.0).shift_s == 0.0
    small = with_shift(EffortLag(0.019, 1e-3), healthy, 2.0)
    assert (small.shift_s, small.is_certain) == (pytest.approx(0.009), False)
    large = with_shift(EffortLag(0.060, 1e-3), healthy, 2.0)
    assert (large.shift_s, large.is_certain) == (pytest.approx(0.050), True)
    for unknown in (EffortLag(), EffortLag(sigma=1e-3)):
        assert with_shift(unknown, healthy, 2.0).shift_s == 0.0
    assert with_shift(EffortLag(0.06, 1e-3), [EffortLag()], 2.0).shift_s == 0.0


def test_shift_moves_the_effort_to_earlier_times():
    telemetry = record()
    fine = block_means(telemetry, described(), 2.0)
    moved = block_means(late(telemetry, 0.05), described(), 2.0)
    inner = slice(20, -20)
    back = aligned(moved, EffortLag(0.05, 1e-3, 0.05))
    change = np.abs(moved.effort - fine.effort)[inner].max()
    assert np.abs(back.effort - fine.effort)[inner].max() < 0.35 * change
