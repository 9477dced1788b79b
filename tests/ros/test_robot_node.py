# SPDX-License-Identifier: Apache-2.0
"""Interface of the simulated arm's node to other nodes."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from rclpy.context import Context
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from ema_ros import topics
from ema_ros.stamps import stamp_from_message
from ema_sim import runner
from ema_sim.robot.arm import JOINT_NAMES, arm_unit
from ema_sim.robot.bench import ArmBench, RobotSettings
from ema_sim.robot.joint import controller_of
from ema_sim.robot.work import RobotArm, WorkSettings
from ema_sim.robot_node import RobotNode

from ..waiting import wait_for
from .spinning import Probe, Spinning, figures, probed

TOPICS = {
    topics.JOINT_STATES: (JointState, topics.STREAM),
    topics.JOINT_COMMANDS: (JointState, topics.STREAM),
    topics.ROBOT_DESCRIPTION: (String, topics.LATCHED),
    topics.TRUE_FRICTION: (JointState, topics.LATCHED),
    topics.PAYLOAD: (Float64, topics.LATCHED),
}

BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture(scope="module", autouse=True)
def _kernels():
    ArmBench(RobotSettings(), WorkSettings(), {}).compile_kernels()


class Listener(Probe):
    """A probe that receives the messages of an arm."""

    def __init__(self, context: Context, node: RobotNode) -> None:
        super().__init__(context, node)
        for name, (kind, qos) in TOPICS.items():
            self.subscribe(kind, name, qos)
        self.subscribe(Clock, "/clock", BEST_EFFORT)

    def stamps(self, topic: str) -> np.ndarray:
        return np.array([stamp_from_message(m.header.stamp) for m in self.received(topic)])

    def frictions(self) -> list[np.ndarray]:
        return [np.array(message.effort) for message in self.received(topics.TRUE_FRICTION)]


@contextmanager
def running(**parameters: Any) -> Iterator[Listener]:
    """Yield the listener of a new, active arm; `wear__elbow` stands for `wear.elbow`."""
    named = {name.replace("__", "."): value for name, value in parameters.items()}
    with probed(RobotNode, Listener, named) as listener:
        assert listener.node.trigger_configure()
        wait_for(
            lambda: all(listener.probe.count_publishers(f"/ema/{name}") for name in TOPICS),
            "the topics",
        )
        assert listener.node.trigger_activate()
        yield listener
        assert not listener.failures


def test_samples_equal_the_samples_of_the_arm_with_wall_clock_stamps(monkeypatch):
    # The schedule is never shifted here, even if the node is late on a busy machine.
    monkeypatch.setattr(runner, "TOLERANCE_S", 1e6)
    with running(seed=3, payload=1.0) as listener:
        listener.until(lambda: len(listener.received(topics.JOINT_STATES)) >= 1000)
        states = listener.received(topics.JOINT_STATES)
        commands = listener.received(topics.JOINT_COMMANDS)
        now_ns = listener.node.get_clock().now().nanoseconds
        assert abs(now_ns - listener.stamps(topics.JOINT_STATES)[-1]) < 10e9
        assert not listener.received("/clock")
    stamps = np.array([stamp_from_message(message.header.stamp) for message in states])
    assert set(np.diff(stamps)) == {2_000_000}
    twin = RobotArm(seed=3, block_s=0.02).begin_cycle(WorkSettings(payload=1.0)).blocks
    blocks = [next(twin) for _ in range(150)]
    start_ns = int(stamp_from_message(listener.received(topics.TRUE_FRICTION)[0].header.stamp))
    first = (stamps[0] - start_ns) // 2_000_000 - 1
    for name in ("position", "velocity", "effort"):
        expected = np.concatenate([getattr(block, name) for block in blocks])
        values = np.array([getattr(message, name) for message in states])
        np.testing.assert_array_equal(values, expected[first : first + len(values)])
    assert {tuple(message.name) for message in (*states, *commands)} == {JOINT_NAMES}
    at = {stamp: state for stamp, state in zip(stamps, states, strict=True)}
    pairs = [(m, at.get(stamp_from_message(m.header.stamp))) for m in commands]
    errors = [np.subtract(m.position, s.position) for m, s in pairs if s is not None]
    assert len(errors) > 900
    assert np.abs(errors).max() < 0.03


def test_description_has_the_joints_with_their_limits():
    with running(seed=5) as listener:
        [message] = listener.until(lambda: listener.received(topics.ROBOT_DESCRIPTION))
    root = ElementTree.fromstring(message.data)
    links = {link.get("name") for link in root.iter("link")}
    for joint, (name, unit) in zip(root.iter("joint"), arm_unit(5).items(), strict=True):
        assert (joint.get("name"), joint.get("type")) == (name, "revolute")
        ends = {joint.find(tag).get("link") for tag in ("parent", "child")}  # pyright: ignore
        assert ends <= links
        limit = joint.find("limit")
        assert limit is not None
        assert float(limit.get("effort", "")) == pytest.approx(controller_of(unit).limit, abs=0.05)
        assert float(limit.get("velocity", "")) == 2.0 * unit.speed
    assert len(links) == 7


def test_accelerated_work_wears_after_the_healthy_cycles_and_wear_is_live():
    fast = {"rate": 40.0, "sample_rate": 20, "cycle_pause": 0.0}
    with running(**fast, healthy_cycles=1, wear__elbow=0.2) as listener:
        listener.until(lambda: len(listener.frictions()) >= 3)
        changes = [Parameter("wear.elbow", value=0.0), Parameter("wear.base", value=1.0)]
        assert all(item.successful for item in listener.node.set_parameters(changes))
        changed_at = len(listener.frictions())
        listener.until(lambda: len(listener.frictions()) >= changed_at + 3)
        # The clock ticks every 10 ms of simulated time; at 20 Hz, with each sample.
        listener.until(lambda: len(listener.received("/clock")) > 100)
        refused = listener.node.set_parameters([Parameter("wear.base", value=-1.0)])
        assert "wear.base" in refused[0].reason
        wait_for(lambda: listener.statuses("simulation"), "the status")
        assert figures(listener.statuses("simulation")[-1])["rate"] == 40.0
    ratios = np.array(listener.frictions())
    elbow, base = JOINT_NAMES.index("elbow"), JOINT_NAMES.index("base")
    # Healthy friction varies by 1 %, and less from cycle to cycle.
    assert ratios[:3, elbow] / ratios[0, elbow] == pytest.approx([1.0, 1.2, 1.4], abs=0.02)
    assert np.diff(ratios[-2:, elbow]) == pytest.approx(0.0, abs=0.02)
    assert np.diff(ratios[-2:, base]) == pytest.approx(1.0, abs=0.05)
    healthy = np.delete(ratios, [elbow, base], axis=1)
    assert healthy == pytest.approx(np.broadcast_to(healthy[0], healthy.shape), abs=0.02)
    starts = listener.stamps(topics.TRUE_FRICTION)
    assert np.diff(starts) == pytest.approx(18.7e9, abs=0.06e9)


def test_payload_is_published_as_it_changes():
    with running(rate=20.0, sample_rate=20, payload=1.5) as listener:
        listener.until(lambda: len(listener.frictions()) >= 2)
        masses = [message.data for message in listener.received(topics.PAYLOAD)]
    # There are two parts per cycle; the gripper closes within two samples.
    assert masses[0] == 0.0
    assert (min(masses), max(masses)) == (0.0, 1.5)
    assert all(before != after for before, after in pairwise(masses))
    assert 4 <= sum(mass in (0.0, 1.5) for mass in masses[1:]) <= 6


def test_two_arms_in_one_graph_keep_to_their_namespaces(graph: Spinning):
    received = {}
    for side, seed in (("left", 1), ("right", 2)):
        received[side] = graph.listen(JointState, f"/{side}/{topics.JOINT_STATES}", topics.STREAM)
        node = RobotNode(
            context=graph.context,
            namespace=f"/{side}",
            parameter_overrides=[
                Parameter("seed", value=seed),
                Parameter("sample_rate", value=100),
            ],
        )
        assert graph.add(node).bring_up()
    wait_for(lambda: all(len(items) >= 100 for items in received.values()), "both arms")
    efforts = {side: [m.effort[0] for m in items[:100]] for side, items in received.items()}
    assert not np.array_equal(efforts["left"], efforts["right"])
    for items in received.values():
        stamps = [stamp_from_message(m.header.stamp) for m in items]
        assert np.diff(stamps).min() > 0


def test_rate_that_does_not_divide_the_control_rate_is_refused():
    with probed(RobotNode, Listener, {"sample_rate": 300}) as listener:
        assert not listener.node.bring_up()
        listener.until_status("lifecycle", "sample_rate = 300 Hz does not divide 1000 Hz")


def test_stopped_arm_starts_again_at_home():
    with running(sample_rate=100) as listener:
        listener.until(lambda: len(listener.received(topics.JOINT_STATES)) >= 150)
        listener.node.trigger_deactivate()
        kept = len(listener.received(topics.JOINT_STATES))
        listener.node.trigger_activate()
        listener.until(lambda: len(listener.received(topics.JOINT_STATES)) > kept + 20)
        states = listener.received(topics.JOINT_STATES)
        moved = np.abs(np.subtract(states[kept - 1].position, states[0].position)).max()
        back = np.abs(np.subtract(states[kept + 5].position, states[0].position)).max()
        assert back < 1e-2 < moved
