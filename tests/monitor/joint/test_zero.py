# SPDX-License-Identifier: Apache-2.0
"""A position with a different zero is named as a rival of the changes that look alike."""

import math
from dataclasses import replace

import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.identification.joint_estimate import identify_record
from ema_monitor.joint.signals import block_means, filtered
from ema_monitor.joint.zero import zero_shift

from .plant import (
    Joint,
    Motion,
    Sensors,
    described,
    healthy_telemetry,
    places,
    telemetry_of,
    tones,
    window_of,
)

JOINT = Joint(gravity=2.0)
HINT = "Or the zero of the position has moved"
MOTIONS = {"tones": tones(), "small": tones(size=0.5), "places": places()}


@pytest.fixture(scope="module", params=MOTIONS.values(), ids=list(MOTIONS))
def motion(request) -> Motion:
    return request.param


@pytest.fixture(scope="module")
def calibration(motion) -> JointCalibration:
    healthy = healthy_telemetry(JOINT, motion=motion)
    calibration = calibrate_joint(list(map(window_of, healthy)), described())
    assert calibration.baseline.shape.has_gravity
    return calibration


def measured(joint: Joint, motion: Motion, by: float = 0.0, seed: int = 9) -> Telemetry:
    """Return a record whose position is shifted by ``by`` [rad]."""
    telemetry = telemetry_of(joint, motion, Sensors(), seed=seed, day=60)
    return replace(telemetry, position=telemetry.position + by, command=telemetry.command + by)


@pytest.mark.parametrize("by", [0.2, -0.5, 1.5, 3.0, 1e5])
@pytest.mark.parametrize("payload", [1.0, 1.3])
def test_different_zero_is_measured(calibration, motion, by, payload):
    preparation = calibration.baseline.preparation
    telemetry = measured(JOINT.times(gravity=payload), motion, by)
    rows = filtered(block_means(telemetry, described(), preparation.cutoff_hz), preparation)
    shift = zero_shift(calibration.baseline.shape, rows).angle
    assert math.remainder(shift - by, 2.0 * math.pi) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("by", [0.2, -0.5, 1.5, 1e5])
def test_different_zero_is_named(calibration, motion, by):
    estimate = identify_record(window_of(measured(JOINT, motion, by)), described(), calibration)
    assert HINT in estimate.reason
    way = math.remainder(by, 2.0 * math.pi)
    assert f"rad {'more' if way > 0.0 else 'less'} than" in estimate.reason


CHANGES: list[dict[str, float]] = [
    {},
    {"gravity": 1.3},
    {"gravity": 0.7, "inertia": 0.9},
    {"coulomb": 1.5},
    {"load": 8.0},
    {"torque": 0.8},
    {"viscous": 3.0},
]


@pytest.mark.parametrize("factors", CHANGES, ids=str)
@pytest.mark.parametrize("seed", [9, 10, 11])
def test_changes_are_not_mistaken_for_a_different_zero(calibration, motion, factors, seed):
    telemetry = measured(JOINT.times(**factors), motion, seed=seed)
    assert HINT not in identify_record(window_of(telemetry), described(), calibration).reason
