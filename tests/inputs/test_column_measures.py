# SPDX-License-Identifier: Apache-2.0
"""Properties of single columns and of pairs of columns."""

import math

import numpy as np
import pytest

from ema_bags.inputs.column_measures import (
    fit_effort,
    held_values,
    lag_between,
    quantisation_step,
    saturated_share,
)

H = 0.002
TIMES = H * np.arange(10_000)


def trapezoids(times):
    """Return the speed of moves back and forth, with ramps of a third and rests between moves."""
    phase = np.mod(times, 2.0)
    ramp = np.clip(np.minimum(phase, 1.6 - phase) / 0.5, 0.0, 1.0)
    return ramp * np.where(np.mod(times, 4.0) < 2.0, 1.0, -1.0)


@pytest.mark.parametrize("lag", [-0.013, 0.0, 0.0005, 0.007, 0.12])
@pytest.mark.parametrize("last", [10_000, 8_300])
def test_lag_is_measured_within_a_fifth_of_a_sample(lag, last):
    """The record ends either in motion or at rest."""
    cause, effect = trapezoids(TIMES + 1.0), trapezoids(TIMES + 1.0 - lag)
    noise = np.random.default_rng(0).normal(0.0, 0.002, len(TIMES))
    measured = lag_between(cause[:last], (effect + noise)[:last], H)
    assert measured == pytest.approx(lag, abs=0.2 * H)


def test_dissimilar_columns_have_no_lag():
    rng = np.random.default_rng(1)
    assert math.isnan(lag_between(trapezoids(TIMES), rng.normal(size=len(TIMES)), H))


@pytest.mark.parametrize("step", [2.0 * np.pi / 4096, 2.69, 1e-3])
def test_quantisation_step_is_detected(step):
    values = step * np.round(40.0 * np.sin(2.0 * TIMES) + 3.3 * np.sin(7.1 * TIMES))
    assert quantisation_step(values + 0.7) == pytest.approx(step, rel=1e-6)
    assert math.isnan(quantisation_step(np.random.default_rng(2).normal(size=3000)))
    assert math.isnan(quantisation_step(np.full(50, 3.0)))


def test_saturation_is_the_share_at_the_limit_and_ignores_a_single_peak():
    effort = 3.0 * np.sin(3.0 * TIMES)
    assert saturated_share(effort) < 0.01
    clipped = np.clip(effort, -2.0, 2.0)
    assert saturated_share(clipped) == pytest.approx(np.mean(np.abs(clipped) == 2.0), abs=1e-3)


def test_repeated_values_count_only_in_motion():
    values = np.repeat(np.sin(np.arange(500) / 20.0), 5)
    values[1000:2000] = 0.4
    moving = np.ones(len(values), dtype=bool)
    moving[1000:2000] = False
    held = held_values(values, moving)
    assert held.every == 5
    assert held.share == pytest.approx(0.8, abs=0.01)
    assert held.longest <= 6


@pytest.mark.parametrize("late", [0, 8])
def test_effort_is_explained_by_the_motion_with_its_lag(late):
    """The joint has friction 1, inertia 0.3 and gravity 0.5; the effort lags by some samples."""
    speed = 2.0 * trapezoids(TIMES)
    position = np.cumsum(speed) * H
    effort = 1.0 * np.tanh(speed / 0.01) + 0.3 * np.gradient(speed, H) + 0.5 * np.sin(position)
    effort += np.random.default_rng(3).normal(0.0, 0.05, len(effort))
    fit = fit_effort(position, np.roll(effort, late), H)
    assert fit is not None
    assert fit.explained > 0.95
    assert fit.lag_s == pytest.approx(late * H, abs=2.0 * H)
    assert fit.inertia > 0.2
    assert fit_effort(np.zeros(1000), effort[:1000], H) is None
