"""What sensors add to the truth."""

import math

import numpy as np
import pytest

from ema_core.telemetry import COLUMNS, Telemetry
from ema_sim.sensors import Sensors

N = 5000
TRUTH = Telemetry(
    7, 1e-4, 3, *(np.random.default_rng(n).normal(0.0, 1.0, N) for n in range(len(COLUMNS)))
)


def sensors(current_noise: float = 0.0, resolutions=None, seed: int = 1) -> Sensors:
    return Sensors(current_noise, resolutions or {}, np.random.default_rng(seed))


def test_perfect_sensors_show_the_truth():
    measured = sensors().measure(TRUTH)
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(measured, column), getattr(TRUTH, column))


def test_noise_is_on_the_current_alone_white_and_of_its_size():
    sigma = 0.3
    measured = sensors(sigma).measure(TRUTH)
    noise = measured.current - TRUTH.current
    # Five standard deviations of mean, deviation and correlation of N Gaussian numbers.
    assert noise.mean() == pytest.approx(0.0, abs=5 * sigma / math.sqrt(N))
    assert noise.std() == pytest.approx(sigma, rel=5 / math.sqrt(2 * N))
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 5 / math.sqrt(N)
    for column in ("command", "position", "speed"):
        np.testing.assert_array_equal(getattr(measured, column), getattr(TRUTH, column))


@pytest.mark.parametrize("column", COLUMNS)
def test_resolution_rounds_to_the_nearest_step(column):
    resolution = 0.03
    measured = sensors(0.0, {column: resolution}).measure(TRUTH)
    steps = getattr(measured, column) / resolution
    np.testing.assert_allclose(steps, np.rint(steps), rtol=0, atol=1e-9)
    error = np.abs(getattr(measured, column) - getattr(TRUTH, column))
    assert error.max() <= resolution / 2 * (1 + 1e-9)
    # Uniform over a step: root mean square q / sqrt 12, here to 5 %.
    assert np.sqrt(np.mean(error**2)) == pytest.approx(resolution / math.sqrt(12), rel=0.05)


def test_noise_comes_before_the_resolution():
    measured = sensors(0.3, {"current": 0.5}).measure(TRUTH)
    steps = measured.current / 0.5
    np.testing.assert_array_equal(steps, np.rint(steps))


def test_noise_does_not_depend_on_the_blocks():
    whole = sensors(0.3).measure(TRUTH)
    same = sensors(0.3)
    parts = [same.measure(TRUTH.part(0, 1700)), same.measure(TRUTH.part(1700, N))]
    joined = np.concatenate([part.current for part in parts])
    np.testing.assert_array_equal(joined, whole.current)


def test_truth_and_time_stay_as_they_are():
    before = TRUTH.current.copy()
    measured = sensors(1.0, {"position": 0.1}).measure(TRUTH)
    np.testing.assert_array_equal(TRUTH.current, before)
    np.testing.assert_array_equal(measured.stamps_ns, TRUTH.stamps_ns)
    assert measured.first_index == TRUTH.first_index


@pytest.mark.parametrize("noise", [-0.1, math.nan, math.inf])
def test_impossible_noise_is_refused(noise):
    with pytest.raises(ValueError, match=f"current_noise = {noise:g} A"):
        sensors(noise)


@pytest.mark.parametrize("resolution", [0.0, -1e-3, math.nan, math.inf])
def test_impossible_resolution_is_refused(resolution):
    with pytest.raises(ValueError, match=f"resolution of speed = {resolution:g}"):
        sensors(0.0, {"speed": resolution})


def test_unknown_column_is_refused():
    with pytest.raises(ValueError, match="unknown telemetry column 'voltage'; known: command"):
        sensors(0.0, {"voltage": 0.1})
