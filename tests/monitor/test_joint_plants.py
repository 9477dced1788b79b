# SPDX-License-Identifier: Apache-2.0
"""Friction, torque, gravity and temperature affect the joints of the benchmark as stated."""

from types import ModuleType

import numpy as np
import pytest

from ema_bags.inputs.mapping import load_mapping
from ema_ros.actuator_file import load_description
from ema_sim.robot.joint import constant_conditions, controller_of, rest, simulate_joint

from ..benchmarks import benchmark

plants = benchmark("joint_plants")
DAY = plants.FIRST_TEST_DAY


def columns(name: str, **case):
    """Return time, speed and effort [N.m or N] of a record that differs only in its faults."""
    unit = plants.Unit(name)
    record = unit.record(DAY, 0, plants.Case(**case))
    log = record.columns
    speed = np.gradient(log["position"], log["time_s"])
    return speed, log["effort"].to_numpy() / unit.joint.logged, record.dry


@pytest.mark.parametrize("name", plants.JOINTS)
def test_doubled_friction_doubles_the_effort_in_the_direction_of_motion(name):
    joint = plants.JOINTS[name]
    speed, healthy, dry = columns(name)
    _, worn, dry_worn = columns(name, friction=2.0)
    assert dry_worn == pytest.approx(2.0 * dry)
    # Only fast strokes, where friction has fallen from its static to its Coulomb value.
    moves = np.abs(speed) > 0.4 * np.quantile(np.abs(speed), 0.98)
    more = np.mean(((worn - healthy) * np.sign(speed))[moves])
    # Load-dependent friction comes in addition: of gravity, constant load and friction of the load
    # side.
    of_load = joint.gravity + joint.constant_load + joint.load_friction
    most = joint.coulomb + 2.0 * joint.load_dependence * (of_load + joint.load_inertia)
    # 10 %: a slow controller moves the worn joint differently.
    assert 0.9 * dry * joint.coulomb < more < 1.1 * dry * most


@pytest.mark.parametrize("name", ["screw", "gantry", "press"])
def test_weaker_motor_needs_more_current_in_the_same_motion(name):
    _, healthy, _ = columns(name)
    _, weak, _ = columns(name, torque=0.9)
    # 1 %: the noise of the effort.
    assert np.std(weak) / np.std(healthy) == pytest.approx(1.0 / 0.9, rel=0.01)


def test_worm_gear_is_self_locking_and_a_harmonic_drive_is_not():
    at, still = np.zeros((1000, 3)), constant_conditions(1000)
    at[:, 0] = 1.0
    fallen = {}
    for name in ("worm", "arm"):
        joint = plants.JOINTS[name]
        unpowered = controller_of(joint)._replace(limit=0.0)
        recorded = simulate_joint(at, still, plants.plant_of(joint), unpowered, rest(1.0))
        fallen[name] = 1.0 - recorded[-1, 1]
    assert fallen["worm"] < 1e-3 < 0.1 < fallen["arm"]


@pytest.mark.parametrize("name", [name for name, plant in plants.JOINTS.items() if plant.play])
def test_play_separates_motor_and_output(name):
    joint = plants.JOINTS[name]
    reference = plants.reference_of(joint, 1.0, 1.0, (1,))
    still, lost = constant_conditions(len(reference)), []
    for play in (1.0, 4.0):
        plant = plants.plant_of(joint, plants.Case(play=play))
        state = rest(float(reference[0, 0]))
        recorded = simulate_joint(reference, still, plant, controller_of(joint), state)
        lost.append(np.diff(np.quantile(recorded[:, 1] - recorded[:, 0], (0.02, 0.98))))
    # A constant load beyond friction and inertia keeps the gear on one flank. The rest is wind-up.
    wider = 0.0 if joint.constant_load > joint.load_friction else 3.0 * joint.play
    assert lost[1] - lost[0] == pytest.approx(wider, abs=0.3 * joint.play)


@pytest.mark.parametrize("name", plants.JOINTS)
def test_friction_scatters_between_days_as_in_machines(name):
    joint = plants.JOINTS[name]
    kelvin, dry = np.transpose([plants.Unit(name).climate(day) for day in range(400)])
    # Standard deviations of 400 days are known to 4 %: 1.5 to 3 %, and 10 to 16 %.
    assert 0.013 < np.std(dry * (1.0 + joint.dry_per_kelvin * kelvin)) < 0.033
    assert 0.09 < np.std(np.exp(joint.viscous_per_kelvin * kelvin)) < 0.18


@pytest.mark.parametrize("name", plants.JOINTS)
def test_log_is_dated_repeatable_and_described(name, tmp_path):
    unit = plants.Unit(name, 1)
    log = unit.record(DAY, 0).columns
    assert log.equals(unit.record(DAY, 0).columns)
    assert not log["effort"].equals(unit.record(DAY + 1, 0).columns["effort"])
    steps = np.diff(log["time_s"])
    assert steps == pytest.approx(1.0 / unit.joint.rate_hz, abs=2e-6)
    assert log["time_s"][0] > plants.START_S + 30.0 * plants.DAY_S
    unit.write_description(tmp_path)
    load_mapping(tmp_path / "mapping.yaml")
    assert load_description(tmp_path / "actuator.yaml").drive == "unknown"
    assert ("command" in log) == (unit.joint.control in ("position", "pd"))


def test_healthy_records_are_spread_over_days():
    days = plants.healthy_days(10, 3)
    assert len(set(days)) == 10
    assert {day for day, _ in days} == {0, 1, 3}


def test_held_out_joints_differ_from_the_others():
    assert not plants.DEVELOPMENT.keys() & plants.HELD_OUT.keys()
    assert len(plants.DEVELOPMENT) >= 8
    assert len(plants.HELD_OUT) >= 4


@pytest.fixture(scope="module")
def joints() -> ModuleType:
    return benchmark("joints")


@pytest.mark.parametrize(
    ("changed", "figures", "expected"),
    [
        ({"torque_per_ampere": ()}, (), "named"),
        ({"torque_per_ampere": ("friction",)}, (), "not separated"),
        ({"friction": ("torque_per_ampere",)}, (), "not separated"),
        ({"friction": ()}, (), "wrong"),
        ({"torque_per_ampere": (), "inertia": ()}, (), "wrong"),
        ({}, ("effort_scatter",), "departed"),
        ({"torque_per_ampere": (), "tracking_lag": ()}, (), "named"),
        ({"tracking_lag": ()}, (), "departed"),
        ({}, (), "missed"),
    ],
)
def test_outcome_of_a_weak_motor_is_reported(joints, changed, figures, expected):
    quantities = {
        name: {"judgement": "unchanged", "rivals": []} for name in joints.NAMES.values()
    } | {name: {"judgement": "changed", "rivals": rivals} for name, rivals in changed.items()}
    ours = {"quantities": quantities, "figures": figures, "verdict": ""}
    assert joints.outcome({"kind": "torque", "ours": ours}) == expected


def test_least_squares_identify_the_friction_of_a_stage(joints, tmp_path):
    unit = plants.Unit("screw")
    healthy = [unit.write(unit.record(0, i), tmp_path, f"{i}") for i in range(3)]
    fit = joints.LeastSquares(unit.joint, healthy)
    worn = unit.write(unit.record(0, 9, plants.Case(friction=1.3)), tmp_path, "worn")
    # Within one day: 2 % for warming, Stribeck friction and noise.
    assert fit.judge(worn)["change"] == pytest.approx(0.3, abs=0.02)
    assert fit.judge(worn)["alarm"]
