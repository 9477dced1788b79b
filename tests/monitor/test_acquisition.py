# SPDX-License-Identifier: Apache-2.0
"""Telemetry with lower rates, other sampling or missing columns: model, limits and verdicts."""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from ema_core.acquisition import Acquisition
from ema_core.description import ActuatorDescription
from ema_core.faults import estimation_error, fault_vector, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.api import find_windows
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.window_fit import window_fit
from ema_monitor.model.monitor_model import MonitorModel
from ema_monitor.plot.fit import plot_fit
from ema_monitor.windows.finder import WindowFinder
from ema_monitor.windows.trigger import Defect, TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim import simulate

from .windows import window_from

FAULTS = {"friction": 0.2, "backlash": 0.3, "short_circuit_b": 0.15, "eccentricity": 0.2}
WAYS = {
    "500 Hz": (2e-3, Acquisition()),
    "filtered": (1e-3, Acquisition("filtered", 1e-3)),
    "instantaneous": (1e-3, Acquisition("instantaneous")),
    "no speed": (1e-3, Acquisition(speed=False)),
    "no current": (1e-3, Acquisition("none")),
}


class Unit(NamedTuple):
    description: ActuatorDescription
    calibration: Calibration
    window: Window
    estimate: Estimate


@cache
def unit(way: str) -> Unit:
    period, acquisition = WAYS[way]
    description = ActuatorDescription(sample_period=period, acquisition=acquisition)
    healthy, faulty = (
        find_windows(
            simulate(faults, cycles, description=description, current_noise=0.02), description
        )
        for faults, cycles in (({}, 8), (FAULTS, 1))
    )
    calibration = calibrate_model(healthy, description)
    estimate = identify(faulty[0], description, calibration)
    return Unit(description, calibration, faulty[0], estimate)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("way", "largest"),
    # Several times the medians of benchmarks/sampling.py; without the current, short circuits are
    # hardly visible.
    [("500 Hz", 2), ("filtered", 2), ("instantaneous", 4), ("no speed", 2.5), ("no current", 12)],
)
def test_faults_are_identified_or_their_uncertainty_is_reported(way: str, largest: float):
    estimate, truth = unit(way).estimate, fault_vector(FAULTS)
    assert estimate.valid
    assert estimation_error(estimate.faults, truth) < largest
    shown = ~estimate.unobservable
    errors, sigma = np.abs(np.array(estimate.faults) - truth), np.array(estimate.sigma)
    assert np.all(errors[shown] < 4.0 * sigma[shown])


@pytest.mark.slow
def test_without_current_short_circuits_are_less_certain_and_this_is_reported():
    reported, full = unit("no current").estimate, unit("filtered").estimate
    assert "the current is not measured" in reported.reason
    assert "not measured" not in full.reason
    shorts = slice(2, 5)
    assert np.min(reported.sigma[shorts]) > 1.2 * np.max(full.sigma[shorts])
    assert not any(cause.name.startswith("current") for cause in reported.causes)
    description, calibration, window, _ = unit("no current")
    settings = SearchSettings(fitness="least_squares")
    assert identify(window, description, calibration, settings).reason == (
        "the current is not measured: fitness least_squares compares currents only, use "
        "band_limited"
    )


@pytest.mark.slow
@pytest.mark.parametrize("way", ["no speed", "no current"])
def test_pictures_and_messages_tolerate_a_missing_column(way: str):
    _, calibration, window, estimate = unit(way)
    fit = window_fit(window, estimate, calibration)
    assert len(fit.current) == (0 if way == "no current" else len(fit.estimated_current))
    assert len(fit.speed) == len(fit.estimated_speed) == len(fit.position)
    assert plot_fit(window, estimate, calibration).get_axes()


@pytest.mark.slow
def test_calibration_of_another_acquisition_is_refused_by_name(tmp_path):
    description, calibration, window, _ = unit("filtered")
    slower = ActuatorDescription(sample_period=1e-3)
    estimate = identify(window, slower, calibration)
    assert not estimate.valid
    assert "current mean, speed measured, the calibration current filtered with 0.001 s" in (
        estimate.reason
    )
    calibration.save(tmp_path / "unit.yaml")
    again = Calibration.load(tmp_path / "unit.yaml")
    assert again.acquisition == description.acquisition
    assert again.calibration_id == calibration.calibration_id
    blind = unit("no current").window
    assert "the current is declared as measured" in identify(blind, description, calibration).reason
    with pytest.raises(ValueError, match="window 0: the current is declared as measured"):
        calibrate_model([blind], description)


def test_filtered_current_equals_the_filter_applied_to_the_current():
    """The closed form of the filter is applied to means over 20 us, the step of the model."""
    command = 3e-3 * np.sin(90.0 * 2e-5 * np.arange(5001))
    fine = window_from(command, sample_period=2e-5)
    coarse = window_from(command[::50], sample_period=1e-3)
    parameters, tau = ActuatorParameters(), 8e-4
    # One step per sample, so that its mean is its value.
    [steps] = MonitorModel(parameters).respond(fine, healthy_faults()).current
    model = MonitorModel(parameters, acquisition=Acquisition("filtered", tau))
    [filtered] = model.respond(coarse, healthy_faults()).current
    state, share, expected = 0.0, -np.expm1(-2e-5 / tau), []
    for number, value in enumerate(steps, 1):
        state += share * (value - state)
        if number % 50 == 0:
            expected.append(state)
    # The command is interpolated over 1 ms instead of 20 us.
    np.testing.assert_allclose(filtered, expected, atol=0.02 * np.max(np.abs(expected)))
    instant = MonitorModel(parameters, acquisition=Acquisition("instantaneous"))
    [last] = instant.respond(coarse, healthy_faults()).current
    np.testing.assert_allclose(last, steps[49::50], atol=0.02 * np.max(np.abs(steps)))


def test_speed_from_position_is_that_of_the_shaft_after_the_play():
    """The mean speeds of the model over samples add up to its travel, including the play."""
    command = 3e-3 * np.sin(60.0 * 1e-3 * np.arange(201))
    parameters = ActuatorParameters()
    window = window_from(command, sample_period=1e-3)
    backlash = fault_vector({"backlash": 0.5})
    model = MonitorModel(parameters, acquisition=Acquisition(speed=False))
    [by_shaft] = model.respond(window, backlash).speed
    [of_motor] = MonitorModel(parameters).respond(window, backlash).speed
    travelled = 1e-3 * parameters.tau * np.cumsum(by_shaft)
    # The loop lags by omega / G_prop, at most 0.9 mrad, and within the play.
    assert np.max(np.abs(travelled - command[1:])) < 1e-3
    # Within the play, the motor turns and the shaft does not.
    assert np.any((by_shaft == 0.0) & (np.abs(of_motor) > 10.0))


def test_missing_column_ends_the_window():
    description = ActuatorDescription(sample_period=1e-3)
    finder = WindowFinder(TriggerSettings(), description)
    whole = simulate(description=description)
    finder.feed(whole.part(0, 50))
    [defect] = finder.feed(replace(whole.part(50, 100), speed=np.zeros(0)))
    assert isinstance(defect, Defect)
    assert defect.reason == "no speed measured from index 51 on, all columns before"


def test_position_in_the_play_is_known_where_the_shaft_moves_without_measured_speed():
    description = ActuatorDescription(sample_period=1e-3, acquisition=Acquisition(speed=False))
    settings = TriggerSettings(windows="any_motion")
    first, *_ = find_windows(simulate(description=description), description, settings)
    assert first.play in (-1.0, 1.0)
