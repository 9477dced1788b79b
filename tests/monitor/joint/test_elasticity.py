# SPDX-License-Identifier: Apache-2.0
"""Elasticity of a gear: detected only if present, and not mistaken for a change of friction."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.calibrations import load_calibration
from ema_monitor.identification.joint_estimate import identify_record
from ema_monitor.joint.comparison import Judgement
from ema_monitor.joint.learning import learn
from ema_monitor.quantities import FRICTION

from .plant import (
    Joint,
    Sensors,
    described,
    healthy_telemetry,
    places,
    telemetry_of,
    tones,
    window_of,
)

STIFF = Joint(gravity=1.5)
ELASTIC = replace(STIFF, resonance_hz=3.0)
SENSORS = Sensors(noise=0.02)


@pytest.fixture(scope="module")
def calibration() -> JointCalibration:
    healthy = healthy_telemetry(ELASTIC, SENSORS, places())
    return calibrate_joint([window_of(telemetry) for telemetry in healthy], described(SENSORS))


def test_elastic_gear_is_detected(calibration):
    assert calibration.baseline.preparation.is_elastic


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    ("h", "bits", "noise"), [(0.01, 20, 0.05), (0.02, 11, 0.05), (0.01, 10, 0.1), (0.02, 12, 0.2)]
)
def test_stiff_gear_is_not_mistaken_for_elastic(h, bits, noise, seed):
    """Jerk and snap filter the noise of a coarse encoder: this improves the prediction slightly."""
    sensors = Sensors(noise=noise, step=2.0 * np.pi / 2**bits)
    motion = tones(h=h) if seed else places(h=h)
    healthy = healthy_telemetry(STIFF, sensors, motion, seed=seed)
    assert not learn(healthy, described(sensors, h)).preparation.is_elastic


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_friction_of_an_elastic_gear_is_as_accurate_as_of_a_stiff_gear(calibration, seed):
    """Without jerk and snap, the errors are 0.2, 0.5 and 0.9 %."""
    worn = ELASTIC.times(coulomb=1.15)
    telemetry = telemetry_of(worn, places(seed=seed), SENSORS, seed=50, day=40)
    estimate = identify_record(window_of(telemetry), described(SENSORS), calibration)
    assert estimate.comparison is not None, estimate.reason
    friction = estimate.comparison[FRICTION]
    assert friction.judgement is Judgement.CHANGED
    assert friction.change == pytest.approx(0.15, abs=0.003)


def test_calibration_file_stores_the_elasticity(calibration, tmp_path):
    path = tmp_path / "calibration.yaml"
    calibration.save(path)
    loaded = load_calibration(path)
    assert isinstance(loaded, JointCalibration)
    assert loaded.baseline.preparation == calibration.baseline.preparation


def test_calibration_file_without_elasticity_describes_a_stiff_gear(calibration, tmp_path):
    path = tmp_path / "calibration.yaml"
    calibration.save(path)
    content = yaml.safe_load(path.read_text())
    del _preparation_of(content)["is_elastic"]
    path.write_text(yaml.safe_dump(content))
    loaded = load_calibration(path)
    assert isinstance(loaded, JointCalibration)
    assert loaded.baseline.preparation == calibration.baseline.preparation._replace(
        is_elastic=False
    )


def _preparation_of(content: dict) -> dict:
    """Return the mapping of the preparation, at any level of the file."""
    if "preparation" in content:
        return content["preparation"]
    return next(_preparation_of(value) for value in content.values() if isinstance(value, dict))
