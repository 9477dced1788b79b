"""A window beside the model's response, thinned for display."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.causes import CauseEstimate
from ema_core.faults import fault_vector
from ema_monitor.diagnosis import identify
from ema_monitor.identification.window_fit import MOST_VALUES, window_fit
from ema_monitor.windows.band import rms

from .windows import refused


@pytest.fixture(scope="module")
def window(windows_of):
    return windows_of({"friction": 0.2})[0]


def test_values_are_means_of_the_samples_at_their_time(window, description, calibration):
    fit = window_fit(window, identify(window, description, calibration), calibration)
    each = round(fit.period / window.sample_period)
    assert len(fit.current) <= MOST_VALUES < len(fit.current) * 2
    assert fit.current[3] == pytest.approx(np.mean(window.current[3 * each : 4 * each]))
    assert fit.position[0] == pytest.approx(np.mean(window.telemetry.position[1 : each + 1]))
    # Its first value is the mean of samples 1 to each, whose middle it stands at.
    assert fit.start == pytest.approx(window.sample_period * (each + 1) / 2)


def test_model_at_the_estimate_is_nearer_to_the_window_than_a_wrong_one(
    window, description, calibration
):
    estimate = identify(window, description, calibration)
    fit = window_fit(window, estimate, calibration)
    wrong = identify(window, description, calibration)
    object.__setattr__(wrong, "faults", type(wrong.faults).of(fault_vector({})))
    other = window_fit(window, wrong, calibration)
    # Friction of 0.2 moves the current by much more than noise and mismatch do.
    assert 3.0 * rms(fit.current - fit.estimated_current) < rms(
        other.current - other.estimated_current
    )
    assert rms(fit.speed - fit.estimated_speed) < 0.1 * rms(fit.speed)


def test_refused_window_shows_what_was_measured_and_no_model(window, calibration):
    fit = window_fit(window, refused("too much noise"), calibration)
    assert np.isfinite(fit.current).all()
    assert np.isnan(fit.estimated_current).all()
    assert np.isnan(fit.estimated_speed).all()


@pytest.mark.parametrize("name", ["load_torque", "command_delay", "position_gain"])
def test_hidden_causes_are_part_of_the_expected_response(window, description, calibration, name):
    estimate = identify(window, description, calibration)
    value = {"load_torque": 0.05, "command_delay": 1e-3, "position_gain": 0.05}[name]
    cause = CauseEstimate(name, value, 1e-4)
    without = window_fit(window, estimate, calibration)
    with_it = window_fit(window, replace(estimate, causes=(cause,)), calibration)
    assert rms(with_it.estimated_current - without.estimated_current) > 1e-3
