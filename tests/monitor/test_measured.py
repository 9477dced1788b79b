# SPDX-License-Identifier: Apache-2.0
"""A measured hidden cause is separated from faults; a wrong measurement is detected."""

import math

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY_PHASE, fault_vector
from ema_monitor.api import identify_motion
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.model.deviations import HIDDEN_CAUSES
from ema_monitor.model.measured import measured_causes, measured_causes_of
from ema_monitor.model.measurements import MeasurementLog
from ema_sim.api import Command, simulate

from .windows import recorded

FRICTION, LOAD = {"friction": 0.2}, {"load_torque": 0.3}
NS = 1_000_000_000


def error(estimate: Estimate, faults) -> float:
    off = np.delete(estimate.faults - fault_vector(faults), ECCENTRICITY_PHASE)
    return float(np.max(np.abs(off)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "causes", "measured"),
    [
        # Without a load, up to 0.0013; measured: 0.0018.
        ({}, LOAD, {"load_torque": (0.3, 0.01)}),
        ({"short_circuit_a": 0.15}, LOAD, {"load_torque": (0.31, 0.01)}),
        ({"gain": 0.65, "backlash": 0.05}, LOAD, {"load_torque": (0.31, 0.01)}),
        # Without the measurement, neither load nor friction is known (off by 0.036, degraded).
        (FRICTION, {"torque_constant": -0.05}, {"torque_constant": (-0.05, 0.002)}),
        (FRICTION, {"winding_temperature": 60.0}, {"winding_temperature": (60.0, 3.0)}),
    ],
)
def test_faults_next_to_a_measured_cause_are_as_accurate_as_without(
    calibration, description, faults, causes, measured
):
    """This holds also if the measurement is off by one sigma."""
    window = recorded(faults, causes)
    estimate = identify(window, description, calibration, measured=measured)
    assert (estimate.verdict, estimate.causes, estimate.alternatives) == ("valid", (), ())
    assert error(estimate, faults) < 0.003
    assert estimate.measured == measured_causes(measured)


@pytest.mark.slow
def test_measured_load_and_different_inertia_are_no_short_circuits(calibration, description):
    window = recorded({"friction": 0.2}, {"load_torque": 0.2, "inertia": 0.2})
    estimate = identify(window, description, calibration, measured={"load_torque": (0.2, 0.01)})
    assert [cause.name for cause in estimate.causes] == ["inertia"]
    assert error(estimate, {"friction": 0.2}) < 0.003


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "causes", "printed"), [({}, {}, 0.3), (FRICTION, LOAD, 0.1)], ids=["none", "another"]
)
def test_wrong_measurement_is_contradicted_by_the_window(
    calibration, description, faults, causes, printed
):
    window = recorded(faults, causes)
    estimate = identify(window, description, calibration, measured={"load_torque": (printed, 0.01)})
    assert f"contradicts it: measured load torque {printed:+.3g} ± 0.01 N.m" in estimate.reason
    # The result equals that without a measurement.
    alone = identify(window, description, calibration)
    assert (estimate.measured, estimate.causes) == ((), alone.causes)
    np.testing.assert_array_equal(estimate.faults, alone.faults)
    np.testing.assert_array_equal(estimate.covariance, alone.covariance)
    assert estimate.evaluations > alone.evaluations
    assert {cause.name for cause in estimate.causes} == set(causes)
    assert error(estimate, faults) < 0.003


@pytest.mark.slow
def test_measured_sigma_is_part_of_the_uncertainty(calibration, description):
    """Only the measurement separates three short circuits from the torque constant."""
    window = recorded({}, {"torque_constant": -0.05})
    sure, unsure = (
        identify(
            window, description, calibration, measured={"torque_constant": (-0.05, sigma)}
        ).sigma.short_circuit_a
        for sigma in (0.002, 0.02)
    )
    assert sure < 0.5 * unsure


def test_other_distances_use_the_measured_value_without_its_sigma(calibration, description):
    """They have no noise with which to weigh the sigma."""
    window = recorded({}, LOAD)
    settings = SearchSettings(fitness="least_squares")
    blind, seeing = (
        identify(window, description, calibration, settings, measured=measured)
        for measured in ({}, {"load_torque": (0.3, 0.01)})
    )
    assert seeing.fitness < 0.1 * blind.fitness
    assert error(seeing, {}) < 0.02


@pytest.mark.slow
def test_wrong_measurement_in_ordinary_motion_is_not_used(calibration, description):
    """If used, it led to three shorts of 0.28 and no friction."""
    moves = Command("moves", amplitude=0.008, rate=0.3, duration=3.0)
    causes = {"load_torque": 0.3, "torque_constant": -0.03}
    telemetry = simulate(FRICTION, command=moves, causes=causes)
    settings = CombinationSettings(wanted_sigma=0.02)
    measured = {"load_torque": (0.1, 0.01), "torque_constant": (-0.03, 0.002)}
    [estimate, *_] = identify_motion(
        telemetry, description, calibration, settings, measured=measured
    )
    assert "contradicts it: measured load torque +0.1 ± 0.01 N.m" in estimate.reason
    assert [cause.name for cause in estimate.measured] == ["torque_constant"]
    assert abs(estimate.faults.friction - 0.2) < 3.0 * estimate.sigma.friction
    assert estimate.faults.short_circuit_a < 3.0 * estimate.sigma.short_circuit_a


@pytest.mark.parametrize(
    ("measurement", "printed"),
    [
        ({"cogging": (0.1, 0.01)}, "unknown measured cause 'cogging'; .*known: load_torque"),
        ({"load_torque": (math.nan, 0.01)}, r"load_torque = nan: expected .*\[-10, 10\] N.m"),
        ({"load_torque": (11.0, 0.01)}, r"load_torque = 11.0: expected .*\[-10, 10\] N.m"),
        ({"load_torque": (0.1, 0.0)}, "load_torque: sigma = 0.0: expected a positive"),
        ({"load_torque": (0.1, math.inf)}, "load_torque: sigma = inf: expected a positive"),
        ({"load_torque": 0.1}, "load_torque = 0.1: expected a value and its standard deviation"),
    ],
)
def test_impossible_measurement_is_refused_by_name_and_value(measurement, printed):
    with pytest.raises(ValueError, match=printed):
        measured_causes(measurement)


@pytest.mark.parametrize(
    ("texts", "printed"),
    [
        (["load_torque=0.1"], "'load_torque=0.1': expected NAME=VALUE:SIGMA"),
        (["load_torque=a:1"], "'load_torque=a:1': expected NAME=VALUE:SIGMA"),
        (["inertia=0:1", "inertia=0:2"], "inertia is given more than once"),
    ],
)
def test_text_that_is_not_a_measurement_is_refused(texts, printed):
    with pytest.raises(ValueError, match=printed):
        measured_causes_of(texts)


def test_measured_causes_have_the_order_of_the_model():
    measured = measured_causes_of(["speed_gain = 0.01:0.001", "load-torque=0.1:0.005"])
    assert [cause.name for cause in measured] == ["load_torque", "speed_gain"]
    assert set(HIDDEN_CAUSES) >= {cause.name for cause in measured}


def test_latest_measurement_of_each_cause_at_the_start_applies():
    log = MeasurementLog()

    def add(stamp_s: float, **values: float) -> None:
        measured = measured_causes({name: (value, 0.1) for name, value in values.items()})
        log.add("flap", round(stamp_s * NS), measured)

    add(3.0, load_torque=0.3)
    add(1.0, load_torque=0.1, winding_temperature=20.0)
    add(2.0, load_torque=0.2)

    def at(start_s: float, max_age_s: float = 10.0) -> dict[str, float]:
        measured = log.at("flap", round(start_s * NS), max_age_s)
        return {cause.name: cause.value for cause in measured}

    assert at(0.9) == {}
    assert at(1.0) == {"load_torque": 0.1, "winding_temperature": 20.0}
    assert at(2.9) == {"load_torque": 0.2, "winding_temperature": 20.0}
    assert at(4.0, 1.0) == {"load_torque": 0.3}
    assert at(4.1, 1.0) == {}
    assert log.at("rudder", 2 * NS) == ()


def test_only_the_latest_measurements_are_kept():
    log = MeasurementLog(most=2)
    for second in range(1, 4):
        log.add("flap", second * NS, measured_causes({"inertia": (0.1 * second, 0.01)}))
    assert log.at("flap", NS) == ()
    assert log.at("flap", 2 * NS)[0].value == pytest.approx(0.2)
    log.clear()
    assert log.at("flap", 2 * NS) == ()
