# SPDX-License-Identifier: Apache-2.0
"""With a known payload, friction is distinguished from a part that is carried only one way.

The same arm is tested with and without the payload in its telemetry.
"""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.acquisition import Acquisition
from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.calibrations import load_calibration
from ema_monitor.diagnosis import identify
from ema_monitor.joint.baseline import Shortcoming
from ema_monitor.joint.record import NS_A_DAY
from ema_monitor.joint.signals import block_means
from ema_monitor.joint.wording import friction_advice
from ema_monitor.quantities import FRICTION
from ema_monitor.reasons import PayloadMissing, TooFewStrokes
from ema_monitor.windows.window import Window
from ema_sim.robot.arm import JOINT_NAMES
from ema_sim.robot.work import ArmTelemetry, RobotArm, WorkSettings

from .plant import FIRST_DAY, described, healthy_telemetry

CYCLES = 2
"""Number of cycles in a record."""
HEALTHY, WORN = 6, 4
BEARING = ("shoulder", "elbow", "wrist_1")
"""Joints that bear the weight of the part."""

Record = tuple[Array, list[ArmTelemetry]]


@pytest.fixture(scope="module", params=[21, 22])
def arm(request) -> list[Record]:
    """Return friction ratios of joints and cycles of each record; the mass of the parts changes."""
    arm = RobotArm(seed=request.param, sample_rate=100)
    masses = np.random.default_rng(request.param).uniform(0.5, 4.0, HEALTHY + WORN)
    wear = dict.fromkeys(JOINT_NAMES, 0.05)
    records = []
    for mass in masses.tolist():
        work = WorkSettings(healthy_cycles=CYCLES * HEALTHY, payload=mass)
        ratios, blocks = [], []
        for _ in range(CYCLES):
            cycle = arm.begin_cycle(work, wear)
            ratios.append(cycle.friction_ratio)
            blocks.extend(cycle.blocks)
        records.append((np.mean(ratios, axis=0), blocks))
    return records


def unit(name: str) -> ActuatorDescription:
    return ActuatorDescription(
        actuator_id=name,
        serial_number="1",
        sample_period=0.01,
        parameters=ActuatorParameters(tau=1.0, k_t=1.0),
        drive="unknown",
        acquisition=Acquisition(current="mean", effort_unit="N.m"),
    )


def window_of(record: Record, name: str, *, has_payload: bool = True) -> Window:
    blocks = record[1]
    command, effort, position, speed = (
        np.concatenate([getattr(block, column)[:, JOINT_NAMES.index(name)] for block in blocks])
        for column in ("position_command", "effort", "position", "velocity")
    )
    stamp_ns = FIRST_DAY * NS_A_DAY + blocks[0].elapsed_ns
    payload = np.concatenate([block.payload for block in blocks]) if has_payload else np.empty(0)
    return Window(Telemetry(stamp_ns, 0.01, 0, command, effort, position, speed, payload=payload))


def calibrated(arm: list[Record], name: str, *, has_payload: bool = True) -> JointCalibration:
    windows = [window_of(record, name, has_payload=has_payload) for record in arm[:HEALTHY]]
    return calibrate_joint(windows, unit(name))


def errors(arm: list[Record], name: str, *, has_payload: bool) -> tuple[list[float], list[bool]]:
    """Return the friction error of each worn record, and whether its interval contains it."""
    calibration = calibrated(arm, name, has_payload=has_payload)
    at = JOINT_NAMES.index(name)
    healthy = float(np.mean([ratios[at] for ratios, _ in arm[:HEALTHY]]))
    errors_found, holds = [], []
    for record in arm[HEALTHY:]:
        window = window_of(record, name, has_payload=has_payload)
        comparison = identify(window, unit(name), calibration).comparison
        assert comparison is not None
        friction = comparison[FRICTION]
        truth = float(record[0][at]) / healthy - 1.0
        errors_found.append(abs(friction.change - truth))
        holds.append(bool(friction.low < truth < friction.high))
    return errors_found, holds


@pytest.mark.slow
@pytest.mark.parametrize("name", BEARING)
def test_friction_is_right_if_the_payload_is_known(arm, name):
    """Friction rises by up to 40 %; its error is below 3 % of healthy, and within its interval."""
    friction_errors, holds = errors(arm, name, has_payload=True)
    assert max(friction_errors) < 0.03
    assert all(holds)
    unknown, _ = errors(arm, name, has_payload=False)
    assert max(unknown) > max(0.05, 4.0 * max(friction_errors))


@pytest.mark.slow
def test_joint_that_bears_the_part_is_compared_only_in_motion_without_it(arm):
    for name in BEARING:
        aware, blind = (calibrated(arm, name, has_payload=has).baseline for has in (True, False))
        assert aware.preparation.is_empty
        assert not blind.preparation.is_empty
        assert aware.shape.unexplained < 0.05 < blind.shape.unexplained
        assert aware.shape.friction_error < 0.06
        assert blind.shape.friction_error > 0.15
        assert Shortcoming.UNCERTAIN_FRICTION in blind.shortcomings
        assert "gripper as payload" in friction_advice(blind)
        assert not friction_advice(aware)
    # The base turns with the part in one direction and without it in the other: all motion is
    # needed.
    assert not calibrated(arm, "base").baseline.preparation.is_empty


@pytest.mark.slow
def test_record_without_payload_is_not_compared_with_empty_motion(arm, tmp_path):
    calibration = calibrated(arm, "elbow")
    path = tmp_path / "elbow.yaml"
    calibration.save(path)
    for of in (calibration, load_calibration(path)):
        estimate = identify(window_of(arm[0], "elbow", has_payload=False), unit("elbow"), of)
        assert not estimate.valid
        assert estimate.reasons == (PayloadMissing(),)
        assert "the payload is not in the telemetry" in estimate.reason
    # Conversely, the payload is ignored.
    plain = calibrated(arm, "elbow", has_payload=False)
    with_it, without = (
        identify(window_of(arm[-1], "elbow", has_payload=has), unit("elbow"), plain).comparison
        for has in (True, False)
    )
    assert with_it == without


@pytest.mark.slow
def test_record_without_empty_motion_in_both_directions_is_not_judged(arm):
    window = window_of(arm[-1], "elbow")
    always = replace(window.telemetry, payload=np.ones(len(window.telemetry)))
    calibration = calibrated(arm, "elbow")
    estimate = identify(replace(window, telemetry=always), unit("elbow"), calibration)
    assert not estimate.valid
    assert "rows" in estimate.reason
    backward = np.diff(window.telemetry.position, prepend=0.0) < 0.0
    one_way = replace(window.telemetry, payload=backward.astype(float))
    estimate = identify(replace(window, telemetry=one_way), unit("elbow"), calibration)
    [reason] = [item for item in estimate.reasons if isinstance(item, TooFewStrokes)]
    assert reason.is_empty
    assert "without a payload" in estimate.reason


def test_rows_near_a_payload_are_left_out():
    [telemetry] = healthy_telemetry()[:1]
    n, h = len(telemetry), telemetry.sample_period
    payload = np.zeros(n)
    payload[n // 2 : n // 2 + 100] = 1.5
    payload[n // 4] = np.nan
    record = replace(telemetry, payload=payload)
    fine = block_means(record, described(), 0.05 / h, is_empty=True)
    assert fine.step_s == h
    reach = round(0.2 / h)
    left_out = np.flatnonzero(~fine.is_usable)
    expected = [
        *range(n // 4 - reach, n // 4 + reach + 1),
        *range(n // 2 - reach, n // 2 + 100 + reach),
    ]
    assert left_out.tolist() == expected
    assert np.all(block_means(record, described(), 0.05 / h).is_usable)


def test_part_that_occurs_only_in_a_later_record_is_left_out():
    records = [
        replace(telemetry, payload=np.zeros(len(telemetry))) for telemetry in healthy_telemetry()
    ]
    description = described()
    windows = list(map(Window, records))
    assert calibrate_joint(windows, description).baseline.preparation.is_empty
    # If one record lacks the payload, it is not used at all.
    mixed = [*windows[:-1], Window(replace(records[-1], payload=np.empty(0)))]
    assert not calibrate_joint(mixed, description).baseline.preparation.is_empty
