# SPDX-License-Identifier: Apache-2.0
"""Effects of sensors and sampling on the true quantities, and noise on the reference current."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from ema_core.acquisition import Acquisition
from ema_core.cause_profiles import Causes, cause_profiles
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import COLUMNS, Telemetry, join
from ema_ros.messages import telemetry_from_message, telemetry_to_message
from ema_sim import simulate
from ema_sim.actuator import SimulatedActuator
from ema_sim.sensors import Sensors

N = 5000
TRUTH = Telemetry(
    7, 1e-4, 3, *(np.random.default_rng(n).normal(0.0, 1.0, N) for n in range(len(COLUMNS)))
)


def sensors(current_noise: float = 0.0, resolutions=None, seed: int = 1) -> Sensors:
    return Sensors(current_noise, resolutions or {}, np.random.default_rng(seed))


def test_noise_is_white_of_the_given_size_and_only_on_the_current():
    sigma = 0.3
    measured = sensors(sigma).measure(TRUTH)
    noise = measured.current - TRUTH.current
    # Five standard deviations of mean, standard deviation and correlation of N Gaussian numbers.
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
    # Uniform over a step: the root mean square is q / sqrt 12, here within 5 %.
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
def test_gain_and_offset_affect_only_their_column(column):
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
    # A cause has its value at the middle of a sample.
    assert ramp[2000 - 1] == pytest.approx(0.5 * (0.19995 - 0.1) / 0.2, abs=1e-12)


def test_delay_of_a_fraction_of_a_sample_is_interpolated():
    line = replace(TRUTH, speed=3.0 * np.arange(N))
    measured = misread(["speed_delay=2.5e-4"], line)
    np.testing.assert_allclose(measured.speed[10:], line.speed[10:] - 3.0 * 2.5, rtol=1e-12)


COMMAND = 2e-3 * np.sin(80.0 * 1e-3 * np.arange(200))
FINE = 100


def sampled(acquisition: Acquisition) -> Telemetry:
    return SimulatedActuator(sample_period=1e-3, acquisition=acquisition).advance(COMMAND)


def fine() -> Telemetry:
    """Return the same motion in samples of 10 us, whose means are nearly the current itself."""
    knots = np.arange(len(COMMAND) + 1)
    command = np.interp(
        np.arange(1, FINE * len(COMMAND) + 1) / FINE, knots, np.concatenate([[0.0], COMMAND])
    )
    return SimulatedActuator(sample_period=1e-3 / FINE).advance(command)


def test_mean_filtered_and_instantaneous_sampling_agree_with_the_current():
    """Compare each sampling with the current in steps of 10 us.

    The motion is equal up to the last bits; chaos would be visible. The instantaneous value differs
    from the mean over the last 10 us: three lags of 10 us pass this much of 67 A/ms in 5 us.
    """
    reference = fine().current.reshape(-1, FINE)
    np.testing.assert_allclose(sampled(Acquisition()).current, reference.mean(axis=1), atol=1e-6)
    instant = sampled(Acquisition("instantaneous")).current
    assert np.max(np.abs(instant - reference[:, -1])) < 0.2
    assert np.std(instant - reference.mean(axis=1)) > 0.1  # the ripple
    tau, state, expected = 3e-4, 0.0, []
    share = -np.expm1(-1e-5 / tau)
    for row in reference:
        for value in row:
            state += share * (value - state)
        expected.append(state)
    filtered = sampled(Acquisition("filtered", tau)).current
    np.testing.assert_allclose(filtered, expected, atol=5e-3)


def test_unmeasured_quantity_is_an_empty_column():
    telemetry = simulate(
        description=ActuatorDescription(
            sample_period=1e-3, acquisition=Acquisition("none", speed=False)
        ),
        current_noise=0.05,
        resolutions={"current": 0.01, "speed": 0.1},
        causes={"current_offset": 0.1, "speed_delay": 1e-3},
    )
    assert telemetry.missing == ("current", "speed")
    assert len(telemetry.position) == len(telemetry) > 0
    again = telemetry_from_message(telemetry_to_message(telemetry, "flap"))
    assert again.missing == telemetry.missing
    assert telemetry.part(3, 9).missing == telemetry.missing


COMPARATOR = ActuatorParameters(f_sm=1e4, L_s=0.1, R_s=1e-4, h_b=1e-4, V_max=5e-3, I_max=1e4)
SLOPE = COMPARATOR.V_max / COMPARATOR.L_s
PERIOD = 1e-4
SAMPLES = 2000


def comparisons(noise_gain: float, hold: float, bias: float) -> np.ndarray:
    """Return the sum of the signs of bias plus noise over the holds of each sample, `(SAMPLES,)`.

    The noise keeps each value for a time ``hold`` [s]. The rotor is locked, the band of the
    hysteresis is nearly zero, and the large inductance keeps the current nearly constant. The
    driven pair therefore gets +V in a step if bias plus noise is positive, and -V if it is
    negative. The change of the current in a sample is proportional to the sum of these signs. The
    mean of the sums gives the share of noise values above minus the bias, and hence their standard
    deviation. The sums are integers only if each value is constant for the time ``hold``.
    """
    p = COMPARATOR
    actuator = SimulatedActuator(
        p,
        sample_period=PERIOD,
        noise_gain=noise_gain,
        noise_hold_s=hold,
        rng=np.random.default_rng(23),
    )
    command = bias * p.k_t / (p.GAP * p.G_prop)
    current = []
    for _ in range(SAMPLES + 1):  # In the first sample, the command reaches its value.
        actuator.advance([command])
        current.append((actuator.state.i_c - actuator.state.i_b) / 2)
    return np.diff(current) / (SLOPE * hold)


@pytest.mark.parametrize(("noise_gain", "hold"), [(1.0, 1e-6), (100.0, 1e-6), (4.0, 1e-5)])
def test_noise_has_its_variance_and_hold_time(noise_gain, hold):
    """The variance is K_noise 1e-6 / t_n; each value is held for t_n, independent of the others."""
    sigma = math.sqrt(noise_gain * 1e-6 / hold)
    holds = round(PERIOD / hold)
    total = comparisons(noise_gain, hold, bias=sigma / 2)
    n = SAMPLES * holds

    share = (1 + total.sum() / n) / 2
    measured = 0.5 * sigma / NormalDist().inv_cdf(share)
    # Five sigma of a share of n: sqrt(p (1 - p) / n) divided by its slope 0.5 pdf(0.5) / sigma. The
    # current itself moves by up to 4e-3 A, on average 0.6 % of the bias: well within the tolerance.
    p = NormalDist().cdf(0.5)
    deviation = math.sqrt(p * (1 - p) / n) / (0.5 * NormalDist().pdf(0.5))
    assert measured == pytest.approx(sigma, rel=5 * deviation)

    # The signs of whole holds add up to integers; values that change within a hold would not.
    whole = np.rint(total)
    np.testing.assert_allclose(total, whole, atol=0.01)
    assert np.abs(whole).max() <= holds
    # The integers have the parity of their count, except for a rare value in the band of one leg.
    assert (whole.astype(int) % 2 != holds % 2).mean() < 0.02
    # The variance is binomial if the values are independent; the tolerance is 5 sigma of a
    # variance.
    expected = holds * 4 * p * (1 - p)
    assert whole.var() == pytest.approx(expected, rel=5 * math.sqrt(2 / SAMPLES))
