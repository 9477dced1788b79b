# SPDX-License-Identifier: Apache-2.0
"""Ripple of the effort along the position: detected if present, and harmless to friction."""

from dataclasses import replace

import numpy as np
import pytest

from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.calibrations import load_calibration
from ema_monitor.identification.joint_estimate import identify_record
from ema_monitor.joint.comparison import Judgement
from ema_monitor.joint.learning import learn
from ema_monitor.quantities import FRICTION

from .plant import Joint, Sensors, described, healthy_telemetry, telemetry_of, tones, window_of

COGGED = Joint(gravity=1.5, ripple=0.5)
SENSORS = Sensors()


def motions(seed: int):
    """Yield records with different motions: a ripple repeating with the motion looks like noise."""
    rng = np.random.default_rng(seed)
    return tones(30.0, speed=float(rng.uniform(0.9, 1.1)), size=float(rng.uniform(0.8, 1.1)))


@pytest.fixture(scope="module")
def calibration() -> JointCalibration:
    healthy = healthy_telemetry(COGGED, SENSORS)
    return calibrate_joint([window_of(telemetry) for telemetry in healthy], described(SENSORS))


def changed(calibration: JointCalibration, joint: Joint, *, shift: float = 0.0, seed: int = 50):
    telemetry = telemetry_of(joint, motions(seed), SENSORS, seed=seed, day=40)
    telemetry = replace(
        telemetry, position=telemetry.position + shift, command=telemetry.command + shift
    )
    estimate = identify_record(window_of(telemetry), described(SENSORS), calibration)
    assert estimate.comparison is not None, estimate.reason
    return estimate.comparison


@pytest.mark.parametrize("waves", [1.1, 2.0, 3.0])
def test_ripple_is_detected_with_its_wave_number(waves):
    joint = replace(COGGED, ripple_waves=waves)
    baseline = learn(healthy_telemetry(joint, SENSORS), described(SENSORS))
    (ripple,) = baseline.preparation.ripples
    assert ripple == pytest.approx(waves, rel=0.003)


@pytest.mark.parametrize("seed", range(4))
def test_joint_without_a_ripple_gets_none(seed):
    joint = Joint(gravity=1.5, stribeck=0.3 * (seed % 2))
    healthy = healthy_telemetry(joint, SENSORS, motions(seed), seed=seed)
    assert learn(healthy, described(SENSORS)).preparation.ripples == ()


def test_two_ripples_are_detected():
    healthy = []
    for telemetry in healthy_telemetry(COGGED, SENSORS):
        second = 0.3 * np.cos(2.0 * np.pi * 1.3 * telemetry.position)
        healthy.append(replace(telemetry, current=telemetry.current + second))
    ripples = learn(healthy, described(SENSORS)).preparation.ripples
    # An error of 0.1 periods over the travel leaves a tenth of a ripple.
    assert sorted(ripples) == pytest.approx([1.3, 3.0], abs=0.1 / 2.4)


def test_friction_with_a_ripple_is_as_accurate_as_without(calibration):
    smooth = replace(COGGED, ripple=0.0)
    healthy = healthy_telemetry(smooth, SENSORS)
    plain = calibrate_joint([window_of(telemetry) for telemetry in healthy], described(SENSORS))
    limit = plain.comparer.smallest_changes[FRICTION]
    assert calibration.comparer.smallest_changes[FRICTION] < 1.1 * limit
    worn = changed(calibration, COGGED.times(coulomb=1.15))
    assert worn[FRICTION].judgement is Judgement.CHANGED
    assert worn[FRICTION].change == pytest.approx(0.15, abs=0.015)
    assert worn[FRICTION].rivals == ()


@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_phase_of_the_ripple_is_independent_in_each_record(shift):
    """An incremental encoder has a different zero after each start."""
    level = replace(COGGED, gravity=0.0)
    healthy = healthy_telemetry(level, SENSORS)
    calibration = calibrate_joint(
        [window_of(telemetry) for telemetry in healthy], described(SENSORS)
    )
    assert changed(calibration, level, shift=shift).changed == ()
    worn = changed(calibration, level.times(coulomb=1.3), shift=shift)
    assert worn[FRICTION].change == pytest.approx(0.3, abs=0.02)


def test_calibration_file_stores_the_ripples(calibration, tmp_path):
    calibration.save(tmp_path / "calibration.yaml")
    loaded = load_calibration(tmp_path / "calibration.yaml")
    assert isinstance(loaded, JointCalibration)
    assert loaded.baseline.preparation == calibration.baseline.preparation
    assert len(loaded.baseline.preparation.ripples) == 1
