# SPDX-License-Identifier: Apache-2.0
"""Effort outside the model widens the interval of friction; noise does not."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.acquisition import Acquisition
from ema_core.arrays import Array
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.joint_calibration import calibrate_joint
from ema_monitor.diagnosis import identify
from ema_monitor.joint.comparing import Comparer
from ema_monitor.joint.comparison import Judgement
from ema_monitor.joint.learning import learn
from ema_monitor.joint.record import NS_A_DAY
from ema_monitor.joint.shape import DRY
from ema_monitor.quantities import FRICTION, FRICTION_OVER_INERTIA, INERTIA, VISCOUS
from ema_monitor.windows.window import Window
from ema_sim.robot.arm import JOINT_NAMES
from ema_sim.robot.work import ArmTelemetry, RobotArm, WorkSettings

from .baselines import HEALTHY, SHAPE, baseline_of, changed, record_of
from .plant import FIRST_DAY, Joint, Sensors, described, healthy_telemetry, places, telemetry_of

Z90 = 1.645


def _with_hidden_effort(seed: int, size: float) -> Telemetry:
    """Return a record with gravity that follows the angle of another joint."""
    record = telemetry_of(Joint(), places(seed=seed), Sensors(noise=0.02), seed=seed)
    hidden_angle = places(seed=1000 + seed).q
    phase = 2.0 * np.pi * np.random.default_rng(seed).random()
    hidden = size * np.sin(hidden_angle + record.position + phase)
    return replace(record, current=record.current + hidden)


@pytest.mark.slow
def test_error_of_the_healthy_friction_covers_effort_outside_the_model():
    missed = []
    for seed in range(20):
        baseline = learn([_with_hidden_effort(seed, 0.8)], described())
        friction = baseline.healthy[DRY] * baseline.shape.coulomb
        missed.append(abs(np.log(friction / Joint().coulomb)) / baseline.shape.friction_error)
    # The random motion of the other joint averages part of the error out: at most one in ten is
    # outside a 90 % interval, and errors reach half a standard deviation.
    assert np.sum(np.array(missed) > Z90) <= 2
    assert np.max(missed) > 0.5


def test_error_of_the_healthy_friction_does_not_contain_noise():
    quiet, loud = (
        learn(healthy_telemetry(Joint(), Sensors(noise=noise), scatter=0.0), described()).shape
        for noise in (0.01, 0.3)
    )
    # The noise is 30 % of the friction; the filter leaves a few per cent of the effort.
    assert loud.unexplained > 5.0 * quiet.unexplained
    assert loud.friction_error < 0.02
    assert quiet.friction_error < 0.01


@pytest.mark.parametrize("ratio", [0.7, 1.4])
def test_interval_of_changed_friction_has_the_error_of_the_healthy_friction(ratio):
    record = record_of(changed(HEALTHY, friction=ratio))
    exact, biased = (
        Comparer(baseline_of(shape=replace(SHAPE, friction_error=error))).compare(record)
        for error in (0.0, 0.4)
    )
    before, after = exact[FRICTION], biased[FRICTION]
    assert after.change == before.change
    assert after.judgement is before.judgement is Judgement.CHANGED
    assert after.smallest_change == before.smallest_change
    # A factor of exp(0.66) of the change in both directions, in addition to the noise of the
    # record.
    ends = sorted(after.change * np.exp([-Z90 * 0.4, Z90 * 0.4]))
    assert after.low < ends[0] + 0.005 * abs(after.change)
    assert after.high > ends[1] - 0.005 * abs(after.change)
    # The error is a factor of the change, so that its sign is certain.
    assert after.low * after.high > 0.0
    over_inertia = biased[FRICTION_OVER_INERTIA]
    before_over = exact[FRICTION_OVER_INERTIA]
    assert over_inertia.high - over_inertia.low > 2.0 * (before_over.high - before_over.low)
    assert biased[INERTIA] == exact[INERTIA]


def test_error_of_the_healthy_friction_does_not_affect_an_unchanged_record():
    record = record_of(HEALTHY)
    exact, biased = (
        Comparer(baseline_of(shape=replace(SHAPE, friction_error=error))).compare(record)
        for error in (0.0, 0.4)
    )
    assert {quantity.judgement for quantity in biased.judged} == {Judgement.UNCHANGED}
    for name in (FRICTION, VISCOUS):
        width = exact[name].high - exact[name].low
        assert biased[name].high - biased[name].low == pytest.approx(width, rel=0.1)


CYCLES = 2
"""Number of cycles in a record."""
HEALTHY_RECORDS, WORN_RECORDS = 6, 2


@pytest.fixture(scope="module")
def arm() -> list[tuple[Array, list[ArmTelemetry]]]:
    """Return friction ratios of joints and cycles of each record; friction grows in the last."""
    arm = RobotArm(seed=3, sample_rate=100)
    wear = dict.fromkeys(JOINT_NAMES, 0.08)
    work = WorkSettings(healthy_cycles=CYCLES * HEALTHY_RECORDS)
    records = []
    for _ in range(HEALTHY_RECORDS + WORN_RECORDS):
        ratios, blocks = [], []
        for _ in range(CYCLES):
            cycle = arm.begin_cycle(work, wear)
            ratios.append(cycle.friction_ratio)
            blocks.extend(cycle.blocks)
        records.append((np.mean(ratios, axis=0), blocks))
    return records


@pytest.mark.slow
@pytest.mark.parametrize("name", JOINT_NAMES)
def test_interval_of_friction_is_valid_for_all_joints_of_an_arm(arm, name):
    at = JOINT_NAMES.index(name)
    description = ActuatorDescription(
        actuator_id=name,
        serial_number="1",
        sample_period=0.01,
        parameters=ActuatorParameters(tau=1.0, k_t=1.0),
        drive="unknown",
        acquisition=Acquisition(current="mean", effort_unit="N.m"),
    )
    windows = []
    for _, blocks in arm:
        command, effort, position, speed = (
            np.concatenate([getattr(block, column)[:, at] for block in blocks])
            for column in ("position_command", "effort", "position", "velocity")
        )
        stamp_ns = FIRST_DAY * NS_A_DAY + blocks[0].elapsed_ns
        windows.append(Window(Telemetry(stamp_ns, 0.01, 0, command, effort, position, speed)))
    ratios = np.array([ratio[at] for ratio, _ in arm])
    calibration = calibrate_joint(windows[:HEALTHY_RECORDS], description)
    for number in range(HEALTHY_RECORDS, len(windows)):
        change = ratios[number] / np.mean(ratios[:HEALTHY_RECORDS]) - 1.0
        comparison = identify(windows[number], description, calibration).comparison
        assert comparison is not None
        friction = comparison[FRICTION]
        assert friction.low < change < friction.high
    # The load of the last two joints does not depend on other joints.
    if name in ("wrist_2", "wrist_3"):
        assert calibration.baseline.shape.friction_error < 0.02
