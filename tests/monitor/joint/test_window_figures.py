# SPDX-License-Identifier: Apache-2.0
"""Figures of a window depend on its motion, and only similar motions are compared."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.joint.window_figures import CommandedMotion, figures_of, mean_of

H = 0.04


def slide(*, friction=0.6, load=0.1, rest=0.3, noise=0.0, signed=True, seconds=30.0, seed=0):
    """Return telemetry of strokes at one speed with rests in between."""
    rng = np.random.default_rng(seed)
    phase = (np.arange(round(seconds / H)) * H) % 10.0
    speed = np.select([phase < 3.0, (phase >= 5.0) & (phase < 8.0)], [1.0, -1.0], 0.0)
    command = np.concatenate([[0.0], np.cumsum(speed)[:-1]]) * H
    current = np.where(speed == 0.0, rest, friction * speed + load)
    current = current + noise * rng.standard_normal(len(speed))
    position = command - 0.01 * speed + 0.1 * noise * rng.standard_normal(len(speed))
    if not signed:
        current = np.abs(current)
    return Telemetry(0, H, 0, command, current, position, np.empty(0))


@pytest.mark.parametrize("signed", [True, False])
def test_levels_are_computed_per_direction_with_and_without_sign(signed):
    [(motion, features, _)] = figures_of(slide(signed=signed))
    assert features["current_forward"] == pytest.approx(0.7)
    assert features["current_backward"] == pytest.approx(0.5)
    assert features["friction_current"] == pytest.approx(0.6)
    assert features["rest_current"] == pytest.approx(0.3)
    assert motion.speed == pytest.approx(1.0)
    assert motion.travel == pytest.approx(3.0)


def test_scatter_and_roughness_of_white_noise_are_right():
    features = mean_of(figures_of(slide(noise=0.05, seconds=600.0)))
    # In a stroke of 60 samples, a line takes 2 of 60 degrees of freedom.
    assert np.exp(features["current_scatter_forward"]) == pytest.approx(0.05, rel=0.05)
    assert np.exp(features["current_roughness_backward"]) == pytest.approx(0.05 * 2**0.5, rel=0.05)
    assert np.exp(features["error_scatter_backward"]) == pytest.approx(0.005, rel=0.05)


def test_parts_are_weighted_by_their_samples():
    some = slide(friction=0.6, seconds=30.0), slide(friction=0.9, seconds=60.0)
    parts = [part for piece in some for part in figures_of(piece)]
    assert mean_of(parts)["friction_current"] == pytest.approx(0.8)


def test_one_way_motion_and_a_window_without_current_have_no_figures():
    still = slide()
    for command, current in (
        (np.zeros(len(still)), still.current),
        (np.arange(len(still)) * H, still.current),
        (still.command, np.empty(0)),
    ):
        assert figures_of(replace(still, command=command, current=current)) == []


def test_motions_are_alike_if_their_ratio_is_near_one():
    motion = CommandedMotion(0.04, 2.0, 1.0)
    assert motion.is_like(CommandedMotion(0.04, 2.05, 0.98))
    assert not motion.is_like(CommandedMotion(0.04, 2.0, 1.4))
    assert not motion.is_like(CommandedMotion(0.04, 1.0, 1.0))
