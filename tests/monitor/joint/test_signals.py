# SPDX-License-Identifier: Apache-2.0
"""All columns of a record pass through one zero-phase filter, whose band follows the motion."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.joint.signals import Preparation, block_means, cutoff_of, filtered, motion_band
from ema_monitor.joint.smoothing import smoothed

from .plant import EXACT, Joint, Sensors, described, ramps, telemetry_of, tones

PREPARATION = Preparation(cutoff_hz=2.0, lag_s=0.0, usual_speed=3.0)


def test_parabola_keeps_its_curvature_and_is_raised_by_the_variance_of_the_filter():
    t, sigma = np.arange(-200.0, 201.0), 7.0
    inner = slice(40, -40)
    lifted = smoothed(t**2, sigma) - t**2
    # The mean of (t + e)^2 is t^2 + sigma^2 for every t. Truncating the Gaussian at four standard
    # deviations lowers its variance by 0.1 %.
    np.testing.assert_allclose(lifted[inner], sigma**2, rtol=2e-3)
    # Zero phase: a line is unchanged.
    np.testing.assert_allclose(smoothed(t, sigma)[inner], t[inner], atol=1e-9)


def test_filtered_column_does_not_depend_on_the_direction_of_time():
    noise = np.random.default_rng(0).standard_normal(500)
    np.testing.assert_allclose(smoothed(noise[::-1], 4.3), smoothed(noise, 4.3)[::-1], atol=1e-12)


def test_columns_filtered_together_and_separately_are_equal():
    columns = np.random.default_rng(1).standard_normal((3, 300))
    alone = np.array([smoothed(column, 5.0) for column in columns])
    np.testing.assert_array_equal(smoothed(columns, 5.0), alone)


def test_linear_relation_between_columns_survives_the_filter():
    """If the effort is a sum of the measured columns, the filtered rows have the same sum."""
    motion = tones(20.0)
    telemetry = telemetry_of(Joint(), motion, Sensors(noise=0.0, speed=True))
    columns = telemetry.position, telemetry.speed
    mixed = telemetry.__class__(
        telemetry.stamp_ns, telemetry.sample_period, 0, telemetry.command,
        3.0 * columns[0] - 0.5 * columns[1] + 0.2, *columns,
    )  # fmt: skip
    rows = filtered(block_means(mixed, described(Sensors(speed=True)), 2.0), PREPARATION)
    expected = 3.0 * rows.position - 0.5 * rows.speed + 0.2
    np.testing.assert_allclose(rows.effort, expected, atol=1e-12)


def test_rows_are_away_from_reversals_and_ends():
    motion = tones(20.0)
    rows = filtered(
        block_means(telemetry_of(Joint(), motion, EXACT), described(), 2.0), PREPARATION
    )
    assert np.all(np.abs(rows.speed) > 0.05 * PREPARATION.usual_speed)
    assert np.all(np.sign(rows.speed) == np.sign(rows.direction))
    # Each stroke has one direction.
    for stroke in np.unique(rows.stroke):
        assert len(np.unique(np.sign(rows.direction[rows.stroke == stroke]))) == 1


@pytest.mark.parametrize("step", [0.0, 2 * np.pi / 16384, 2 * np.pi / 4096, 2 * np.pi / 1024])
@pytest.mark.parametrize("noise", [0.0, 5e-4])
def test_band_follows_the_motion_and_not_quantisation_or_noise(step, noise):
    motion = tones(40.0, h=0.002)
    record = telemetry_of(Joint(), motion, Sensors(step=step, position_noise=noise))
    # The faster tone has 0.83 Hz. The window spreads a line over two bins of 1/40 Hz.
    assert motion_band(record) == pytest.approx(0.83, abs=0.06)


def test_band_scales_with_the_speed_of_the_motion():
    slow, fast = (
        motion_band(telemetry_of(Joint(), tones(speed=speed), EXACT)) for speed in (1.0, 2.0)
    )
    assert fast == pytest.approx(2.0 * slow, abs=0.06)


@pytest.mark.parametrize("h", [0.001, 0.01])
@pytest.mark.parametrize("step", [0.0, 2 * np.pi / 16384, 2 * np.pi / 4096])
def test_quantisation_at_a_constant_speed_does_not_widen_the_band(h, step):
    """At 0.5 rad/s, the steps of an encoder have fixed frequencies."""
    record = telemetry_of(Joint(), ramps(h=h), Sensors(step=step))
    # A square wave of 0.25 Hz has 81 % of its power there, and 95 % up to its fifth harmonic;
    # reversals of 0.1 s reduce this little.
    assert motion_band(record) == pytest.approx(1.25, abs=0.03)


def test_cutoff_is_between_the_slowest_and_a_share_of_the_rate():
    assert cutoff_of(1.0, 0.001) == 2.5
    assert cutoff_of(0.01, 0.001) == 1.5
    assert cutoff_of(100.0, 0.01) == pytest.approx(20.0)
    # A fifth of 5 Hz is below the slowest cut-off.
    assert cutoff_of(0.01, 0.2) == pytest.approx(1.0)


@pytest.mark.parametrize("strokes", [1, 2, 4])
def test_strokes_are_counted_by_reversals_and_long_ones_are_divided(strokes):
    seconds = 8.0
    t = 0.01 * np.arange(round(2 * strokes * seconds / 0.01))
    speed = np.sign(np.sin(np.pi * t / seconds + 1e-9))
    position = 0.01 * np.cumsum(speed)
    telemetry = Telemetry(0, 0.01, 1, position, speed, position, np.empty(0))
    lost = np.zeros(len(t), dtype=bool)
    lost[400:450] = True  # A gap does not divide a stroke.
    for record in (telemetry, replace(telemetry, interpolated=lost)):
        signals = filtered(
            block_means(record, described(), 2.0), PREPARATION._replace(usual_speed=1.0)
        )
        for way in (1, -1):
            assert signals.strokes(way) == strokes
            assert signals.pieces(way) == 4 * strokes
