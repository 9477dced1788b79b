# SPDX-License-Identifier: Apache-2.0
"""The simulated arm has the friction, cycles, wear and temperatures of its settings."""

from itertools import islice

import numpy as np
import pytest

from ema_sim.robot.arm import JOINT_NAMES, arm_unit, gravity_load, part_inertia
from ema_sim.robot.cycle import HOME, plan_cycle
from ema_sim.robot.joint import CONTROL_S
from ema_sim.robot.work import (
    ArmTelemetry,
    RobotArm,
    WearSettings,
    WorkSettings,
    simulate_work,
    work_of_day,
)

SHORT = WorkSettings(cycle_pause=0.5)


def cycles(arm: RobotArm, n: int, work: WorkSettings = SHORT, **wear: float):
    """Return the next cycles and their telemetry, each in one block."""
    pairs = []
    for _ in range(n):
        cycle = arm.begin_cycle(work, wear)
        [telemetry] = cycle.blocks
        pairs.append((cycle, telemetry))
    return pairs


def mean_conditions(arm: RobotArm, telemetry: ArmTelemetry, name: str) -> tuple[float, float]:
    """Return the mean factors of dry and viscous friction by temperature."""
    joint, i = arm.joints[name], JOINT_NAMES.index(name)
    kelvin = telemetry.temperature[:, i] - 28.0
    dry = float(np.mean(1.0 + joint.dry_per_kelvin * kelvin))
    return dry, float(np.mean(np.exp(joint.viscous_per_kelvin * kelvin)))


def least_squares(arm: RobotArm, n: int, name: str) -> tuple[float, ...]:
    """Return estimated over true Coulomb friction, viscous friction and inertia of a joint.

    Load-dependent friction is given, because in some joints the load hardly changes in a cycle.
    """
    joint, i = arm.joints[name], JOINT_NAMES.index(name)
    rows, efforts, truths = [], [], []
    for cycle, log in cycles(arm, n):
        part = SHORT.payload * cycle.plan.weight(0, 2 * len(log))[1::2]
        load = gravity_load(log.position.T, part)[i]
        load_inertia = joint.load_inertia + part_inertia(part)[i]
        v, a = log.velocity[:, i], np.gradient(log.velocity_command[:, i], 1.0 / log.rate)
        speed, sign = np.abs(v), np.sign(v)
        # Above the Stribeck range, and 0.2 s away from rests and reversals, where the gear winds
        # up.
        is_fast = speed > 3.0 * joint.stribeck_speed
        moves = np.convolve(is_fast, np.ones(201), "same") > 200.5
        grease = (speed / (0.5 * joint.speed)) ** (joint.grease - 1.0)
        dry, thick = mean_conditions(arm, log, name)
        dry *= cycle.friction_ratio[i]
        transmitted = np.abs(load + load_inertia * a + sign * joint.load_friction)
        effort = log.effort[:, i] - dry * joint.load_dependence * transmitted * sign
        columns = [sign, v * grease, (joint.motor_inertia + load_inertia) * a, load]
        if joint.asymmetry:
            columns.append(np.ones(len(log)))
        rows.append(np.column_stack(columns)[moves])
        efforts.append(effort[moves])
        truths.append((dry * joint.coulomb, thick * joint.viscous, 1.0))
    fit = np.linalg.lstsq(np.concatenate(rows), np.concatenate(efforts), rcond=None)[0]
    return tuple(fit[:3] / np.mean(truths, axis=0))


@pytest.mark.parametrize("name", JOINT_NAMES)
def test_least_squares_identify_the_friction_of_each_joint(name):
    coulomb, viscous, inertia = least_squares(RobotArm(seed=1), 5, name)
    # The regression neglects the elastic gear and the drift of temperature within the cycles.
    assert coulomb == pytest.approx(1.0, abs=0.02)
    assert viscous == pytest.approx(1.0, abs=0.04)
    assert inertia == pytest.approx(1.0, abs=0.06)


def test_cycles_repeat_apart_from_the_goals():
    (_, first), (_, second) = cycles(RobotArm(), 2)
    assert len(first) == len(second)
    difference = second.position - first.position
    # Goals vary by 0.015 rad, at most 2.5 times that in each of two cycles.
    assert 0.002 < np.abs(difference).max() < 2 * 2.5 * 0.015 + 0.005
    assert np.abs(difference).std() < 0.1 * first.position.std(axis=0).min()


def test_cycle_lasts_as_long_as_ordinary_work_with_rests():
    cycle = RobotArm().begin_cycle()
    assert 15.0 < cycle.samples / 500 < 25.0
    assert cycle.plan.moving_s < cycle.samples / 500 - 4.0


def test_every_joint_follows_its_command_and_moves_in_both_directions():
    [(_, log)] = cycles(RobotArm(), 1)
    assert np.abs(log.position - log.position_command).max() < 0.03
    assert (log.velocity.max(axis=0) > 0.3).all()
    assert (log.velocity.min(axis=0) < -0.3).all()
    integral = np.cumsum(log.velocity, axis=0) / log.rate
    # The quantised position and the noisy speed belong to one shaft, except for the play before the
    # encoder of wrist_3.
    assert np.abs(integral - (log.position - log.position[0])).max() < 0.02


def test_reference_is_smooth_and_its_columns_are_derivatives():
    plan = plan_cycle(0.5, np.random.default_rng(0))
    n = round(plan.starts[-1] / CONTROL_S)
    position, speed, acceleration = np.moveaxis(plan.reference(0, n), 2, 0)
    for values, rate in ((position, speed), (speed, acceleration)):
        # The mean of the rate over a period of 1 ms, up to the third derivative.
        assert np.diff(values) / CONTROL_S == pytest.approx(
            0.5 * (rate[:, 1:] + rate[:, :-1]), abs=2e-2
        )
    np.testing.assert_allclose(position[:, [0, -1]].T, [HOME, HOME], atol=1e-12)


def test_samples_do_not_depend_on_blocks_or_on_an_unfinished_cycle_before():
    [whole] = RobotArm(seed=3).begin_cycle(SHORT).blocks
    blocks = list(RobotArm(seed=3, block_s=0.02).begin_cycle(SHORT).blocks)
    assert [block.elapsed_ns for block in blocks[:3]] == [2_000_000, 22_000_000, 42_000_000]
    for column in ("position", "velocity", "effort", "velocity_command", "temperature"):
        joined = np.concatenate([getattr(block, column) for block in blocks])
        np.testing.assert_allclose(joined, getattr(whole, column), rtol=1e-12, atol=1e-12)

    arm = RobotArm(seed=3, block_s=0.02)
    assert len(list(islice(arm.begin_cycle(SHORT).blocks, 150))) == 150
    again = next(iter(arm.begin_cycle(SHORT).blocks))
    assert again.elapsed_ns == 3_002_000_000
    assert np.abs(again.position - HOME).max() < 1e-3


def test_slower_telemetry_has_mean_efforts_and_sampled_positions():
    arms = RobotArm(sample_rate=500), RobotArm(sample_rate=50)
    [fast], [slow] = (list(arm.begin_cycle(SHORT).blocks) for arm in arms)
    np.testing.assert_array_equal(fast.position[9::10][: len(slow)], slow.position)
    mean = fast.effort.reshape(-1, 10, 6).mean(axis=1)
    noise = np.array([j.effort_noise * j.coulomb for j in arms[0].joints.values()])
    assert (np.std(mean - slow.effort, axis=0) / noise) == pytest.approx(
        np.sqrt(1.1),
        rel=0.1,  # The tolerance for 1130 samples is 2 %.
    )


def test_rate_that_does_not_divide_the_rate_of_the_controllers_is_refused():
    with pytest.raises(
        ValueError, match=r"sample_rate = 300 Hz does not divide 1000 Hz: .* 250, 500"
    ):
        RobotArm(sample_rate=300)


def test_friction_grows_by_the_wear_after_the_healthy_cycles():
    work = WorkSettings(cycle_pause=0.0, healthy_cycles=2)
    worn, healthy = RobotArm(seed=2), RobotArm(seed=2)
    pairs = list(
        zip(cycles(worn, 6, work, elbow=0.1, wrist_2=0.05), cycles(healthy, 6, work), strict=True)
    )
    growth = np.array([w.friction_ratio / h.friction_ratio - 1.0 for (w, _), (h, _) in pairs])
    expected = np.zeros((6, 6))
    expected[:, 2], expected[:, 4] = [0.0, 0.0, 0.1, 0.2, 0.3, 0.4], [0, 0, 0.05, 0.1, 0.15, 0.2]
    assert growth == pytest.approx(expected, abs=1e-12)

    (_, log), (_, usual) = pairs[-1]
    for i, joint in enumerate(worn.joints.values()):
        fast = np.abs(usual.velocity[:, i]) > 0.3
        more = np.mean(((log.effort - usual.effort)[:, i] * np.sign(usual.velocity[:, i]))[fast])
        # Load-dependent friction also grows, by at most 0.08 of 60 N.m.
        least = growth[-1, i] * joint.coulomb
        assert 0.9 * least - 0.01 < more < 1.1 * (least + 5.0 * growth[-1, i]) + 0.01, joint


def test_healthy_friction_varies_by_about_a_per_cent():
    arm = RobotArm(sample_rate=20)
    ratios = []
    for _ in range(60):
        cycle = arm.begin_cycle(WorkSettings(cycle_pause=3000.0))
        ratios.append(cycle.friction_ratio)
    # 60 cycles of 0.84 h with a correlation time of 2 h: 12 independent values of 6 joints.
    assert np.std(ratios) == pytest.approx(0.01, rel=0.35)


@pytest.mark.slow
def test_gears_warm_up_in_work_and_thin_grease_needs_less_effort():
    arm = RobotArm()
    first, *_, last = [log for _, log in cycles(arm, 25)]
    assert first.temperature[0] == pytest.approx(22.0, abs=0.1)
    # Warming of 6 to 9 K in continuous work with 87 % of motion, after 480 s of 900 s.
    duty = 16.7 / (len(last) / 500)
    warming = np.array([joint.warming for joint in arm.joints.values()])
    reached = duty * (1.0 - np.exp(-25 * len(last) / 500 / 900.0))
    assert last.temperature[-1] - 22.0 == pytest.approx(reached * warming, rel=0.02)
    i = JOINT_NAMES.index("wrist_2")
    moves = np.abs(last.velocity[:, i]) > 0.5
    efforts = [np.mean(np.abs(log.effort[moves, i])) for log in (first, last)]
    assert efforts[1] < 0.99 * efforts[0]


def test_part_is_carried_only_from_pick_to_place():
    (cycle, log), (_, empty) = (
        cycles(RobotArm(), 1, WorkSettings(cycle_pause=0.5, payload=mass))[0] for mass in (4.0, 0.0)
    )
    share = cycle.plan.weight(0, 2 * len(log))[1::2]
    assert set(np.unique(share)) >= {0.0, 1.0}
    assert 0.2 < share.mean() < 0.6
    more = (log.effort - empty.effort)[:, 1]
    # At least 4 kg at 0.3 m during transport; filtered transients of the controller elsewhere.
    assert np.median(more[share == 1.0]) < -4.0 * 9.81 * 0.3
    assert abs(np.median(more[share == 0.0])) < 1.0


def test_units_differ_in_friction_and_are_reproducible_by_seed():
    frictions = np.array([[j.coulomb for j in arm_unit(seed).values()] for seed in range(50)])
    spread = np.log(frictions / frictions.mean(axis=0)).std()
    assert spread == pytest.approx(0.08, rel=0.15)  # The tolerance for 300 values is 4 %.
    assert arm_unit(7) == arm_unit(7)


def test_day_of_work_changes_the_parts_and_the_air():
    works = [work_of_day(hour) for hour in np.arange(0.0, 24.0, 0.5)]
    ambient = [work.ambient for work in works]
    assert max(ambient) - min(ambient) == pytest.approx(8.0, abs=0.1)
    assert np.argmax(ambient) == 30
    assert len({work.payload for work in works}) > 5
    pairs = list(simulate_work(0.02, seed=4, wear={"base": 0.5}))
    assert [cycle.number for cycle, _ in pairs] == [0, 1, 2, 3]
    assert pairs[1][1].time_s[0] == pytest.approx(pairs[0][1].time_s[-1] + 0.002)
    assert pairs[-1][0].friction_ratio[0] == pytest.approx(3.0, rel=0.05)


def test_wear_of_an_unknown_size_is_refused():
    with pytest.raises(ValueError, match="elbow"):
        WearSettings(elbow=-0.1)
