# SPDX-License-Identifier: Apache-2.0
"""The friction curve of a record is its true friction, and leaves the healthy band if it rises."""

import numpy as np
import pytest

from ema_monitor.calibration.joint_calibration import calibrate_joint
from ema_monitor.identification.joint_estimate import record_curve
from ema_monitor.joint.curve import FrictionCurve
from ema_monitor.windows.window import Window

from .plant import (
    Joint,
    Motion,
    Sensors,
    described,
    healthy_telemetry,
    ramps,
    telemetry_of,
    tones,
    window_of,
)

LATER = 60
PLAIN = Joint(gravity=0.4)


def curve_of(healthy: Joint, tested: Joint, motion: Motion | None = None) -> FrictionCurve:
    calibration = calibrate_joint(
        [window_of(telemetry) for telemetry in healthy_telemetry(healthy)], described(None)
    )
    telemetry = telemetry_of(tested, motion or tones(), Sensors(), seed=9, day=LATER)
    curve = record_curve(window_of(telemetry), described(None), calibration)
    assert curve is not None
    return curve


def true_friction(joint: Joint, speed: np.ndarray) -> np.ndarray:
    dip = joint.stribeck * np.exp(-((speed / joint.stribeck_speed) ** 2))
    return (joint.coulomb + dip) * np.sign(speed) + joint.viscous * speed


@pytest.mark.parametrize(
    "joint",
    [PLAIN, Joint(gravity=0.4, inertia=0.5), Joint(stribeck=0.4), Joint(gravity=0.6, load=-0.5)],
    ids=["plain", "inertia", "Stribeck", "load"],
)
def test_curve_of_a_healthy_record_is_the_true_friction_within_the_band(joint: Joint):
    """The tolerance is 5 % of Coulomb friction.

    Slow bins may lack rows, because the filter leaves out reversals.
    """
    curve = curve_of(joint, joint)
    covered = np.isfinite(curve.latest)
    assert np.mean(covered) > 0.75
    away = (curve.latest - true_friction(joint, curve.speed))[covered]
    assert np.sqrt(np.mean(away**2)) < 0.05 * joint.coulomb
    assert np.all(curve.healthy_low < curve.healthy_high)
    is_inside = (curve.latest > curve.healthy_low) & (curve.latest < curve.healthy_high)
    assert np.mean(is_inside[covered]) > 0.8


def test_increased_friction_leaves_the_band_at_every_speed():
    curve = curve_of(PLAIN, PLAIN.times(coulomb=1.5))
    covered = np.isfinite(curve.latest)
    beyond = np.where(
        curve.speed > 0.0, curve.latest > curve.healthy_high, curve.latest < curve.healthy_low
    )
    assert np.all(beyond[covered])


def test_increased_viscous_friction_is_proportional_to_the_speed():
    curve = curve_of(PLAIN, PLAIN.times(viscous=2.0))
    excess = curve.latest - 0.5 * (curve.healthy_low + curve.healthy_high)
    covered = np.isfinite(excess)
    slope = np.polyfit(curve.speed[covered], excess[covered], 1)[0]
    assert slope == pytest.approx(PLAIN.viscous, rel=0.1)


def test_records_of_one_speed_show_no_friction_at_other_speeds():
    joint = Joint(inertia=1e-4)
    records = [
        window_of(telemetry_of(joint, ramps(), Sensors(), seed=seed, day=seed)) for seed in range(4)
    ]
    curve = record_curve(records[0], described(None), calibrate_joint(records, described(None)))
    assert curve is not None
    assert np.min(np.abs(curve.speed)) > 0.3
    assert np.any(np.isfinite(curve.latest))


def test_record_that_cannot_be_compared_has_no_curve():
    calibration = calibrate_joint(
        [window_of(telemetry) for telemetry in healthy_telemetry(PLAIN)], described(None)
    )
    slow = telemetry_of(PLAIN, tones(speed=0.2), Sensors(), seed=9, day=LATER)
    window: Window = window_of(slow)
    assert record_curve(window, described(None), calibration) is None
