"""Positions that are renewed more slowly than they are published change no tracking lag."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.repetition import between_renewals, held_samples
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.identification.joint_estimate import identify_record
from ema_monitor.joint.comparison import FRICTION, TRACKING
from ema_monitor.joint.renewal import renewed

from .plant import Joint, Sensors, described, healthy_telemetry, telemetry_of, tones, window_of

JOINT = Joint(gravity=0.4)
COLUMNS = ("position", "current")


def repeated(telemetry, held, names=COLUMNS):
    """Return telemetry in which some columns repeat each value."""
    rows = np.arange(len(telemetry)) // held * held
    return replace(telemetry, **{name: getattr(telemetry, name)[rows] for name in names})


@pytest.fixture(scope="module")
def calibration() -> JointCalibration:
    return calibrate_joint(list(map(window_of, healthy_telemetry(JOINT))), described())


@pytest.mark.parametrize("held", [2, 3, 7])
def test_position_is_on_the_line_between_renewals(held):
    times = 1e-3 * np.arange(4000)
    position = np.sin(3.0 * times) * (times < 2.0) + np.sin(6.0) * (times >= 2.0)
    position += np.where(times > 3.0, np.sin(3.0 * (times - 3.0)), 0.0)
    steps = position[np.arange(4000) // held * held]
    assert held_samples(steps) == held
    step, error = 3e-3, between_renewals(steps, held)[:-held] - position[:-held]
    assert np.max(np.abs(steps - position)) > 0.9 * step * (held - 1)
    # A line deviates by an eighth of acceleration times the square of its length, but where the
    # motion begins and ends.
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
    assert expected.comparison is not None
    assert actual.comparison is not None
    assert not actual.comparison.changed
    for name in (TRACKING, FRICTION):
        change = actual.comparison[name].change - expected.comparison[name].change
        assert abs(change) < 0.03, name
