# SPDX-License-Identifier: Apache-2.0
"""Quality of an estimate: cost, goodness of fit and standard deviations."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, estimation_error, fault_vector
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.identification.fitness import FITNESS
from ema_monitor.identification.search_settings import GOODNESS_LIMIT, SearchSettings
from ema_monitor.identification.uncertainty import (
    MISMATCH_FACTOR,
    MISMATCH_SIGMA,
    USUAL_MISFIT,
    WIDTHS,
    sandwich_covariance,
)
from ema_monitor.windows.band import band_limited, rms

from .reference_cases import CASES
from .windows import changed, fitness_for


def expected_response(calibration, window, faults, play):
    return calibration.expect(calibration.model().respond(window, faults, play), window)


@pytest.mark.slow
@pytest.mark.parametrize("fitness", FITNESS)
def test_fitness_is_the_sum_of_squares_at_the_estimate(
    windows_of, calibration, description, fitness
):
    """The motor is eccentric: where the phase is unobservable, it is set after the search."""
    truth = CASES["eccentricity low"]
    [window] = windows_of(truth)
    estimate = identify(window, description, calibration, SearchSettings(fitness=fitness))
    response = expected_response(calibration, window, estimate.faults, estimate.play_offset)
    row = fitness_for(fitness, window, calibration).residuals(response)
    # Converting fault vectors to the point and back: rounding, times a steep current.
    assert estimate.fitness == pytest.approx(np.sum(row**2), rel=1e-6)
    # Measured: 0.3 % in the band, and up to 0.7 % sample by sample.
    assert estimation_error(estimate.faults, fault_vector(truth)) < 1.5


@pytest.mark.parametrize("spoiled", ["current", "speed"])
def test_goodness_of_fit_is_that_of_the_worse_quantity_in_its_band(
    windows_of, calibration, description, spoiled
):
    [window] = windows_of(CASES["eccentricity low"])
    t = window.sample_period * np.arange(len(window) + 1)
    amplitude = {"current": 0.08, "speed": 0.3}[spoiled]
    spoilt = getattr(window.telemetry, spoiled) + amplitude * np.sin(2 * np.pi * 37.0 * t)
    window = changed(window, **{spoiled: spoilt})
    estimate = identify(window, description, calibration)
    response = expected_response(calibration, window, estimate.faults, estimate.play_offset)
    missed = [window.current - response.current[0], window.telemetry.speed[1:] - response.speed[0]]
    left = [rms(band_limited(row, window.sample_period)) for row in missed]
    ratios = np.array(left) / [calibration.healthy_rms, calibration.healthy_speed_rms]
    assert np.argmax(ratios) == ["current", "speed"].index(spoiled)
    assert estimate.goodness_of_fit == pytest.approx(np.max(ratios), rel=1e-6)


def test_goodness_limit_is_a_setting_and_follows_the_worst_short_circuit(
    windows_of, calibration, description, estimates
):
    """A phase with a third of its turns has a third of the inductance to limit its ripple."""
    [window] = windows_of(CASES["short circuit high"])
    estimate = estimates("short circuit high")
    expected = GOODNESS_LIMIT / np.sqrt(1.0 - estimate.faults[2])
    assert estimate.goodness_limit == pytest.approx(expected, rel=1e-12)
    assert estimate.verdict == "valid"
    strict = SearchSettings(goodness_limit=0.5)
    degraded = identify(window, description, calibration, strict)
    # Most of the departure from healthy is still explained.
    assert degraded.valid
    assert degraded.verdict == "degraded"
    assert "standard deviations are widened" in degraded.reason
    assert degraded.unexplained_share < 0.1
    assert degraded.goodness_limit == pytest.approx(expected * 0.5 / GOODNESS_LIMIT, rel=1e-12)
    assert np.array_equal(degraded.faults, estimate.faults)


def test_sigma_agrees_with_derivatives_by_the_faults(windows_of, calibration, description):
    """Derivatives by eccentricity and phase, without the plane, give the same sigma.

    The noise of 1 A outweighs the allowance for the mismatch of the model.
    """
    [window] = windows_of(CASES["eccentricity high"])
    noise = np.random.default_rng(12).normal(0.0, 1.0, len(window) + 1)
    window = changed(window, current=window.telemetry.current + noise)
    settings = SearchSettings(fitness="least_squares")
    estimate = identify(window, description, calibration, settings)

    # Steps as in the plane, and one-sided at the bounds.
    around = 2 * np.pi * estimate.faults[ECCENTRICITY]
    step = np.full(8, 5e-3)
    step[[ECCENTRICITY, ECCENTRICITY_PHASE]] = 1e-2, 1e-2 / around
    points = estimate.faults + np.concatenate([np.diag(step), -np.diag(step)])
    points = np.clip(points, 0.0, 1.0)
    step = np.sum(points[:8] - points[8:], axis=1)
    current = expected_response(calibration, window, points, estimate.play_offset).current
    above, below = np.split(current, 2)
    at = expected_response(calibration, window, estimate.faults, estimate.play_offset).current[0]
    covariance = sandwich_covariance((above - below).T / step, window.current - at, 50)
    factor = MISMATCH_FACTOR * max(1.0, estimate.goodness_of_fit / USUAL_MISFIT)
    expected = factor**2 * np.diag(covariance) + MISMATCH_SIGMA**2
    expected[ECCENTRICITY_PHASE] += (1 / around**2 - 1) * MISMATCH_SIGMA[ECCENTRICITY_PHASE] ** 2
    # Derivatives with other steps, of a model with dry friction, differ by some per cent.
    assert estimate.sigma == pytest.approx(np.sqrt(expected), rel=0.15)
    assert estimate.sigma[ECCENTRICITY] > 2 * MISMATCH_SIGMA[ECCENTRICITY]
    # Half of the distribution is narrow; the other half ends at 1.28 of its width.
    low, high = estimate.quantiles[[0, -1], ECCENTRICITY]
    width = np.sqrt(estimate.goodness_of_fit * covariance[ECCENTRICITY, ECCENTRICITY])
    assert (high - low) / 2 == pytest.approx(1.28 * WIDTHS[1] * width, rel=0.15)


def test_calibration_on_one_window_widens_sigma_like_the_worst_valid_fit(
    windows_of, healthy_windows, description
):
    """With a known scatter that puts the same residual at the limit, the result is the same."""
    [window] = windows_of(CASES["friction low"])
    blind = calibrate_model(healthy_windows[:1], description)
    blind = replace(blind, unit_covariance=np.zeros_like(blind.unit_covariance))
    seeing = replace(blind, healthy_rms=1e-3, healthy_speed_rms=1e3)
    settings = SearchSettings(fitness="least_squares", goodness_limit=1e6)
    unknown, certain = (
        identify(window, description, calibration, settings) for calibration in (blind, seeing)
    )
    assert (unknown.valid, unknown.verdict) == (True, "degraded")
    assert "the fit cannot be judged" in unknown.reason
    assert "healthy windows of the calibration (1)" in unknown.reason
    assert np.isnan(unknown.goodness_of_fit)
    assert np.isnan(unknown.unexplained_share)
    np.testing.assert_array_equal(unknown.faults, certain.faults)
    # Variance of the friction from the residuals, without the allowance for the mismatch; the ridge
    # of the covariance, 0.1 % of it, is constant.
    [actual, expected] = (
        estimate.sigma[0] ** 2 - MISMATCH_SIGMA[0] ** 2 for estimate in (unknown, certain)
    )
    expected *= (GOODNESS_LIMIT / max(USUAL_MISFIT, certain.goodness_of_fit)) ** 2
    assert actual == pytest.approx(expected, rel=2e-3)
