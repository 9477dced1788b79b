# SPDX-License-Identifier: Apache-2.0
"""A standstill is stored as values; text and units are added when it is shown."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ema_core.linear import DisplayUnit, angle_shown
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.joint.standstill import Standstill, standstill_of
from ema_monitor.reason_texts import text_of
from ema_monitor.reasons import StandstillCause

from .plant import Joint, Sensors, described, healthy_telemetry, telemetry_of, tones, window_of

JOINT = Joint(gravity=0.4)
STANDSTILL = Standstill(StandstillCause.SHORT_COMMAND, 0.5, 1.0, 0.2, 0.8)


@pytest.fixture(scope="module")
def calibration() -> JointCalibration:
    return calibrate_joint(list(map(window_of, healthy_telemetry(JOINT))), described())


@pytest.mark.parametrize(
    ("effort", "command", "cause"),
    [
        (1.0, 1.0, StandstillCause.FAILURE),
        (1.0, 0.1, StandstillCause.SHORT_COMMAND),
        (0.1, 1.0, StandstillCause.NO_EFFORT),
        (0.1, 0.1, StandstillCause.NO_EFFORT),
    ],
)
def test_cause_of_a_standstill_follows_from_effort_and_command(
    calibration, effort: float, command: float, cause
):
    """The effort is relative to the healthy friction, the command to healthy commands."""
    moving = telemetry_of(JOINT, tones(), Sensors(), seed=9)
    friction = calibration.baseline.friction
    record = replace(
        moving, command=command * moving.command, current=np.full(len(moving), effort * friction)
    )
    standstill = standstill_of(record, calibration.baseline)
    assert standstill.cause is cause
    assert standstill.travel == pytest.approx(np.ptp(record.command))
    assert standstill.effort == pytest.approx(effort * friction)
    assert standstill.friction == friction


@pytest.mark.parametrize(
    ("lead", "travels"), [(0.0, ("0.5 rad", "1 rad")), (0.01, ("0.8 mm", "1.6 mm"))]
)
def test_travel_is_shown_in_the_unit_of_the_axis(lead: float, travels: tuple[str, str]):
    """With a lead of 10 mm, a radian is 1.6 mm."""
    angle = angle_shown(described(lead=lead).parameters)
    text = text_of(STANDSTILL.reason(DisplayUnit("N.m", 1.0), angle))
    assert f"the command travels {travels[0]}: command at least {travels[1]}" in text


@pytest.mark.parametrize("cause", [StandstillCause.FAILURE, StandstillCause.NO_EFFORT])
def test_effort_is_shown_in_its_unit(cause: StandstillCause):
    scale = 2.0 * math.pi / 0.01
    standstill = replace(STANDSTILL, cause=cause)
    text = text_of(standstill.reason(DisplayUnit("N", scale), DisplayUnit("mm", 1.0)))
    assert "at an effort of 1.3e+02 N" in text
