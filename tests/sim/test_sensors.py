"""What sensors add to the truth."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ema_core.cause_profiles import Causes, cause_profiles
from ema_core.telemetry import COLUMNS, Telemetry, join
from ema_sim.sensors import Sensors

N = 5000
TRUTH = Telemetry(
    7, 1e-4, 3, *(np.random.default_rng(n).normal(0.0, 1.0, N) for n in range(len(COLUMNS)))
)


def sensors(current_noise: float = 0.0, resolutions=None, seed: int = 1) -> Sensors:
    return Sensors(current_noise, resolutions or {}, np.random.default_rng(seed))


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


@pytest.mark.parametrize("resolution", [0.0, -1e-3, math.nan, math.inf])
def test_impossible_resolution_is_refused(resolution):
    with pytest.raises(ValueError, match=f"resolution of speed = {resolution:g}"):
        sensors(0.0, {"speed": resolution})


def misread(causes: Causes, *blocks: Telemetry) -> Telemetry:
    reader = sensors()
    reader.set_causes(cause_profiles(causes))
    return join([reader.measure(block) for block in blocks])


@pytest.mark.parametrize("column", ["current", "speed", "position"])
def test_gain_and_offset_are_those_of_one_column(column):
    measured = misread([f"{column}_gain=-0.05", f"{column}_offset=0.1"], TRUTH)
    for name in COLUMNS:
        truth = getattr(TRUTH, name)
        expected = 0.95 * truth + 0.1 if name == column else truth
        np.testing.assert_allclose(getattr(measured, name), expected, rtol=0, atol=1e-15)


def test_offset_begins_at_its_time_after_the_first_block():
    step = misread(["current_offset=0.5@0.02"], TRUTH)
    np.testing.assert_array_equal(step.current[:200], TRUTH.current[:200])
    np.testing.assert_array_equal(step.current[200:], TRUTH.current[200:] + 0.5)
    ramp = misread(["current_offset=0.5@0.1..0.3"], TRUTH).current - TRUTH.current
    # A cause has the value of the middle of a sample.
    assert ramp[2000 - 1] == pytest.approx(0.5 * (0.19995 - 0.1) / 0.2, abs=1e-12)


def test_delay_of_a_fraction_of_a_sample_is_interpolated():
    line = replace(TRUTH, speed=3.0 * np.arange(N))
    measured = misread(["speed_delay=2.5e-4"], line)
    np.testing.assert_allclose(measured.speed[10:], line.speed[10:] - 3.0 * 2.5, rtol=1e-12)
