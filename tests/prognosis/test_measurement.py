"""Measurements: what they accept, refuse and show."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, FaultVector, healthy_faults
from ema_monitor.prognosis.growth.measurement import Measurement

from .made_tests import made_test

PHASE = FAULT_NAMES.index("eccentricity_phase")
NONE = np.zeros(8, dtype=bool)


def test_measurement_of_an_estimate_has_its_figures():
    faults = np.linspace(0.1, 0.8, 8)
    made = replace(made_test(0), faults=faults, covariance=1e-5 * np.eye(8), unobservable=NONE)
    seen = Measurement.of(made, 120)
    assert seen.hours == 120.0
    np.testing.assert_array_equal(seen.faults, faults)
    np.testing.assert_allclose(seen.noise, 1e-5)


def test_invalid_estimate_measures_nothing():
    with pytest.raises(ValueError, match="measures nothing: a gap"):
        Measurement.of(made_test(0, valid=False), 10.0)


def test_component_at_its_healthy_value_is_known_only_to_be_near_it():
    faults = healthy_faults()
    faults[0] = 0.02
    unobservable = NONE.copy()
    unobservable[1] = True
    seen = Measurement(10.0, faults, 1e-5 * np.eye(8), unobservable)
    np.testing.assert_array_equal(np.flatnonzero(~seen.near_healthy), [0, 1])


def test_unobservable_components_need_no_figures():
    faults, covariance = healthy_faults(), 1e-5 * np.eye(8)
    faults[PHASE] = np.nan
    covariance[PHASE] = covariance[:, PHASE] = np.nan
    unobservable = NONE.copy()
    unobservable[PHASE] = True
    seen = Measurement(10.0, faults, covariance, unobservable)
    assert np.isfinite(seen.noise).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hours": -1.0}, "hours = -1.0 h"),
        ({"hours": np.nan}, "hours = nan h"),
        ({"faults": np.zeros(7)}, r"faults of a measurement has shape \(7,\)"),
        ({"covariance": np.zeros(8)}, "covariance of a measurement has shape"),
        ({"faults": np.full(8, np.nan)}, "is not finite"),
        ({"covariance": np.full((8, 8), np.nan)}, "variances"),
        ({"covariance": -np.eye(8)}, "variances"),
    ],
)
def test_impossible_measurement_is_refused(changes, message):
    figures = {
        "hours": 10.0,
        "faults": FaultVector.of(healthy_faults()),
        "covariance": np.eye(8),
        "unobservable": NONE,
    }
    with pytest.raises(ValueError, match=message):
        Measurement(**(figures | changes))
