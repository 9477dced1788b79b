# SPDX-License-Identifier: Apache-2.0
"""Faults next to a sensor error: right within their sigma, or refused with the reason."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY_PHASE, fault_vector
from ema_core.levels import ERROR, WARN
from ema_monitor import find_windows, identify
from ema_monitor.health import HealthLimits, assess
from ema_monitor.identification.estimate import Estimate
from ema_sim import simulate

from .windows import once

RUBBING = {"friction": 0.22}
SHORTED = {"short_circuit_b": 0.114, "short_circuit_c": 0.318}
LOOSE = {"backlash": 0.3, "gain": 0.6, "short_circuit_a": 0.3}


@once
def recorded(faults: Mapping[str, float]):
    return simulate(dict(faults), seed=1, current_noise=0.05)


def estimated(faults: Mapping[str, float], column: str, error: str, value: float) -> Estimate:
    """Return the estimate of a test with a gain, an offset relative to the peak, or a delay [s]."""
    telemetry = recorded(faults)
    values = getattr(telemetry, column)
    if error == "gain":
        values = (1.0 + value) * values
    elif error == "offset":
        values = values + value * np.max(np.abs(values))
    else:
        at = np.arange(len(values)) * telemetry.sample_period
        values = np.interp(at - value, at, values)
    [window] = find_windows(replace(telemetry, **{column: values}))
    return identify(window)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "column", "error", "value", "level"),
    [
        # Mistaken for inertia or torque constant.
        (RUBBING, "current", "gain", -0.22, WARN),
        ({"friction": 0.6}, "current", "gain", -0.21, ERROR),
        ({"eccentricity": 0.4, "friction": 0.05}, "current", "gain", 0.15, WARN),
        ({"eccentricity": 0.4, "friction": 0.05}, "current", "gain", 0.09, WARN),
        # Mistaken for short circuits of all phases.
        (SHORTED, "current", "gain", 0.15, ERROR),
        (SHORTED, "current", "gain", 0.24, ERROR),
        # Mistaken for a load.
        (LOOSE, "current", "offset", -0.2, ERROR),
        (LOOSE, "current", "offset", 0.3, ERROR),
        # Not explained.
        (LOOSE, "current", "delay", -2e-3, ERROR),
        (RUBBING, "speed", "delay", 2.5e-3, WARN),
    ],
)
def test_faults_are_right_next_to_an_error_of_a_sensor(faults, column, error, value, level):
    """The error is within 3 sigma, although the limit is 5."""
    estimate = estimated(faults, column, error, value)
    assert estimate.valid
    away = np.abs(np.delete(estimate.faults - fault_vector(dict(faults)), ECCENTRICITY_PHASE))
    assert np.all(away < 3.0 * np.delete(estimate.sigma, ECCENTRICITY_PHASE))
    # Right, not merely uncertain.
    assert np.max(away) < 0.02
    [cause] = estimate.causes
    assert cause.name == f"{column}_{error}"
    assert assess(estimate, HealthLimits()).level == level


@pytest.mark.slow
@pytest.mark.parametrize("delay", [-5e-3, 6e-3])
def test_sensor_error_at_the_limit_of_the_search_is_refused(delay):
    estimate = estimated(RUBBING, "current", "delay", delay)
    assert not estimate.valid
    assert "a sensor error is too large to be corrected: delay of the current" in estimate.reason


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "mistake"),
    [(2.0**0.5, "is a peak given for RMS?"), (0.5**0.5, "is RMS given for a peak?")],
)
def test_gain_of_a_usual_mistake_is_refused_next_to_a_fault(factor, mistake):
    estimate = estimated(RUBBING, "current", "gain", factor - 1.0)
    assert not estimate.valid
    assert mistake in estimate.reason
