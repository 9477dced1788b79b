# SPDX-License-Identifier: Apache-2.0
"""Positions that are updated more slowly than published do not change the tracking lag."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.columns.repetition import between_renewals, held_samples, irregular_updates
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.identification.estimate import Verdict
from ema_monitor.identification.joint_estimate import comparable_record, identify_record
from ema_monitor.joint.renewal import renewed
from ema_monitor.quantities import FRICTION, TRACKING

from .plant import Joint, Sensors, described, healthy_telemetry, telemetry_of, tones, window_of

JOINT = Joint(gravity=0.4)
MEANS = [1.5, 2.2, 3.3, 6.0]
COLUMNS = ("position", "current")


def repeated(telemetry, held, names=COLUMNS):
    """Return telemetry in which some columns repeat each value."""
    rows = np.arange(len(telemetry)) // held * held
    return replace(telemetry, **{name: getattr(telemetry, name)[rows] for name in names})


def irregular(telemetry, mean, names=("position",), seed=0):
    """Return telemetry in which some columns are updated with a probability of 1/mean."""
    is_new = np.random.default_rng(seed).random(len(telemetry)) < 1.0 / mean
    rows = np.maximum.accumulate(np.where(is_new, np.arange(len(telemetry)), 0))
    return replace(telemetry, **{name: getattr(telemetry, name)[rows] for name in names})


@pytest.fixture(scope="module")
def calibration() -> JointCalibration:
    return calibrate_joint(list(map(window_of, healthy_telemetry(JOINT))), described())


@pytest.mark.parametrize("held", [2, 3, 7])
def test_position_is_interpolated_between_updates(held):
    times = 1e-3 * np.arange(4000)
    position = np.sin(3.0 * times) * (times < 2.0) + np.sin(6.0) * (times >= 2.0)
    position += np.where(times > 3.0, np.sin(3.0 * (times - 3.0)), 0.0)
    steps = position[np.arange(4000) // held * held]
    assert held_samples(steps) == held
    step, error = 3e-3, between_renewals(steps, held)[:-held] - position[:-held]
    assert np.max(np.abs(steps - position)) > 0.9 * step * (held - 1)
    # Linear interpolation deviates by acceleration times length squared / 8, except at the
    # beginning and end of the motion.
    assert np.percentile(np.abs(error), 99.0) < 1.01 * 9.0 * (1e-3 * held) ** 2 / 8.0
    assert np.max(np.abs(error)) <= step * held


def test_telemetry_without_repetition_is_unchanged():
    telemetry = telemetry_of(JOINT, tones(), Sensors())
    assert renewed(telemetry) is telemetry
    coarse = replace(telemetry, position=np.round(telemetry.position / 1.5e-3) * 1.5e-3)
    assert renewed(coarse) is coarse
    effort = repeated(telemetry, 4, ("current",))
    assert renewed(effort) is effort


@pytest.mark.parametrize("held", [3, 5, 8])
@pytest.mark.parametrize("names", [("position",), COLUMNS])
def test_repeated_position_changes_no_judgement(calibration, held, names):
    plain = telemetry_of(JOINT, tones(), Sensors(), seed=9, day=60)
    expected, actual = (
        identify_record(window_of(record), described(), calibration)
        for record in (plain, repeated(plain, held, names))
    )
    assert actual.verdict != Verdict.DEPARTED
    assert expected.comparison is not None
    if not actual.valid:
        assert [reason.code for reason in actual.reasons] == ["other_updates"]
    compared = calibration.comparer.compare(
        comparable_record(window_of(repeated(plain, held, names)), described(), calibration)
    )
    assert not compared.changed
    for name in (TRACKING, FRICTION):
        change = compared[name].change - expected.comparison[name].change
        assert abs(change) < 0.03, name


@pytest.mark.parametrize("names", [("position",), COLUMNS])
@pytest.mark.parametrize("mean", MEANS)
def test_irregular_updates_of_the_position_are_no_departure(calibration, mean, names):
    plain = telemetry_of(JOINT, tones(), Sensors(), seed=9, day=60)
    estimate = identify_record(window_of(irregular(plain, mean, names)), described(), calibration)
    assert estimate.verdict == Verdict.REFUSED
    assert [reason.code for reason in estimate.reasons] == ["other_updates"]
    updates = irregular_updates(irregular(plain, mean).position)
    assert updates is not None
    assert updates.mean == pytest.approx(mean, rel=0.1)
    assert f"is updated every {updates.mean:.1f} samples on average" in estimate.reason


@pytest.mark.parametrize("mean", MEANS)
def test_changed_friction_is_detected_with_irregular_updates(calibration, mean):
    rough = replace(JOINT, coulomb=1.5 * JOINT.coulomb)
    telemetry = irregular(telemetry_of(rough, tones(), Sensors(), seed=9, day=60), mean)
    estimate = identify_record(window_of(telemetry), described(), calibration)
    assert estimate.verdict == Verdict.DEPARTED
    assert estimate.comparison is not None
    assert estimate.comparison[FRICTION].change == pytest.approx(0.5, abs=0.1)


def test_records_with_irregular_updates_are_compared_with_each_other():
    healthy = [irregular(record, 2.2, seed=i) for i, record in enumerate(healthy_telemetry(JOINT))]
    calibration = calibrate_joint(list(map(window_of, healthy)), described())
    plain = telemetry_of(JOINT, tones(), Sensors(), seed=9, day=60)
    estimate = identify_record(window_of(irregular(plain, 2.2, seed=99)), described(), calibration)
    assert estimate.valid
    assert estimate.verdict != Verdict.DEPARTED


@pytest.mark.parametrize("count", [0.0, 1e-5, 2e-4, 1.5e-3, 6e-3])
def test_encoder_counts_and_pauses_of_the_motion_are_not_updates(count):
    plain = telemetry_of(JOINT, tones(), Sensors()).position
    moves = np.concatenate([np.cumsum(0.01 * np.sin(np.linspace(0, np.pi, 60))), np.zeros(12)])
    moves[60:] = moves[59]
    pauses = np.concatenate([moves + i * moves[-1] for i in range(40)])
    for position in (plain, pauses):
        coarse = np.round(position / count) * count if count else position
        assert irregular_updates(coarse) is None
