# SPDX-License-Identifier: Apache-2.0
"""The bridge between the robot of another manufacturer and the monitor."""

import array
import math
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Bool, Float64, Float64MultiArray

from ema_bags.inputs import bridged_robot
from ema_bags.inputs.bridge_node import BridgeNode
from ema_bags.inputs.bridging import Bridge
from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.input_defect import Factor, InputDefect, OutOfRange
from ema_core.description import ActuatorDescription
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_interfaces.msg import MeasuredCauses, TelemetryBlock
from ema_monitor import calibrate, find_windows
from ema_monitor.model.measured import checked_causes
from ema_ros.messages import description_from_message, measured_from_message
from ema_ros.stamps import stamp_from_message, stamp_to_message
from ema_ros.status import ERROR, OK, STALE, WARN, Task
from ema_ros.topics import LATCHED, LATCHED_BY_MANY, STREAM
from ema_sim import simulate

from ..waiting import wait_for
from .graph import Graph
from .spinning import Spinning, made

STATES = "/joint_states"
JOINT_STATE = {
    "joint": "flap_joint",
    "position": {"topic": STATES, "type": "sensor_msgs/msg/JointState", "source": "position"},
    "speed": {"topic": STATES, "source": "velocity", "shaft": "user"},
    "current": {"topic": STATES, "source": "effort"},
    "command": {"topic": "/command", "source": "data[1]", "between": "hold"},
}
HELD = {"topic": "/command", "source": "data", "between": "hold"}
FRICTION = 0.25
# The position follows the command, but is not a copy of it.
GAIN = 1.02
START_NS = 1_700_000_000_000_000_000


@pytest.fixture
def mapping_file(tmp_path):
    """Return a function that writes a mapping with some sections changed; None omits one."""

    def write(**changes):
        content = {k: v for k, v in (JOINT_STATE | changes).items() if v is not None}
        path = tmp_path / "mapping.yaml"
        path.write_text(yaml.safe_dump(content))
        return path

    return write


@pytest.fixture(autouse=True)
def _soon(monkeypatch):
    monkeypatch.setattr(bridged_robot, "SILENT_S", 1.0)


def joint_state(stamp_ns: int, joint: str, position: float, velocity: float, effort: float) -> Any:
    """Return a joint state message with ``joint`` and another joint, as any robot sends it."""
    message = JointState(name=["other", joint])
    message.header.stamp = stamp_to_message(stamp_ns)
    for name, value in {"position": position, "velocity": velocity, "effort": effort}.items():
        setattr(message, name, array.array("d", [0.0, value]))
    return message


@pytest.mark.long
def test_robot_with_joint_states_is_estimated_live(mapping_file, tmp_path):
    """The robot publishes at 1 kHz; its command is on a separate topic, before each state."""
    unit = ActuatorDescription(sample_period=1e-3)
    calibration = calibrate(find_windows(simulate({}, 5, description=unit), unit), unit)
    calibration.save(tmp_path / "calibration.yaml")
    robot = simulate({"friction": FRICTION}, 6, description=unit)
    with Graph(tmp_path / "graph") as graph:
        graph.start("monitor", calibration_file=tmp_path / "calibration.yaml")
        graph.start("bridge", mapping_file=mapping_file())
        for name in ("monitor", "bridge"):
            status = f"/ema/{name}: lifecycle"
            graph.wait_for(
                lambda status=status: graph.reports(status, "active"), f"{name} is active"
            )
        states = graph.node.create_publisher(JointState, STATES, 5000)
        commands = graph.node.create_publisher(Float64MultiArray, "/command", 5000)
        for publisher in (states, commands):
            graph.wait_for(publisher.get_subscription_count, "the bridge")
        start_s, start_ns = time.monotonic(), time.time_ns()
        for i in range(len(robot)):
            time.sleep(max(start_s + 1e-3 * i - time.monotonic(), 0.0))
            commands.publish(Float64MultiArray(data=[0.1, robot.command[i]]))
            speed = robot.speed[i] * unit.parameters.tau
            stamp_ns = start_ns + (i + 1) * 10**6
            columns = robot.position[i], speed, robot.current[i]
            states.publish(joint_state(stamp_ns, "flap_joint", *columns))
        graph.wait_for(lambda: len(graph.estimates) >= 2, "two estimates")
        for estimate in graph.estimates[:2]:
            assert estimate.valid, estimate.reason
            # 1 % of the range: the accuracy with means over 1 or 2 ms (docs/accuracy.md).
            assert abs(estimate.faults.friction - FRICTION) < 0.01
        values = graph.status["/ema/bridge: input"].values
        assert "1000 Hz" in graph.log("bridge").read_text()
        assert (values["lost"], values["withheld"], values["clock jumps"]) == ("0", "0", "0")
        mapping = graph.status["/ema/bridge: mapping"]
        assert mapping.level == OK, mapping.message
        assert graph.stop("bridge") == 0


class Session:
    """A bridge in this process, and a node that publishes its input and receives its output."""

    def __init__(self, graph: Spinning, mapping: Path, bridge: BridgeNode | None = None) -> None:
        self.bridge = bridge or bridge_of(graph, mapping)
        assert self.bridge.bring_up()
        self.descriptions = graph.listen(DescriptionMessage, "/ema/actuator_description", LATCHED)
        self.blocks: list[TelemetryBlock] = graph.listen(TelemetryBlock, "/ema/telemetry", STREAM)
        robot = graph.node("other")
        # Best effort, like sensors: the bridge requests no more than a publisher offers.
        best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.states = robot.create_publisher(JointState, STATES, best_effort)
        self.commands: Any = robot.create_publisher(Float64, "/command", 10)
        self.joint = "flap_joint"
        self._time_s, self.step_s = 0.0, 1e-3

    def publish_next(self, effort_factor: float = 1.0) -> None:
        """Publish the next sample of a sine, by default at 1 kHz, as position and command."""
        self._time_s += self.step_s
        t = self._time_s
        angle, rate = 0.01 * math.sin(20.0 * t), 0.2 * math.cos(20.0 * t)
        effort = math.sin(t) * effort_factor
        self.commands.publish(Float64(data=GAIN * angle))
        stamp_ns = START_NS + round(t * 1e9)
        self.states.publish(joint_state(stamp_ns, self.joint, angle, rate, effort))

    def publish_until(
        self, condition: Callable[[], Any], what: str, effort_factor: float = 1.0
    ) -> None:
        def publish_and_ask() -> Any:
            self.publish_next(effort_factor)
            return condition()

        wait_for(publish_and_ask, what)

    def task(self, name: str) -> Task:
        return next(item for item in self.bridge.tasks() if item.name == name)


def bridge_of(graph: Spinning, mapping: Path) -> BridgeNode:
    return graph.managed(BridgeNode, mapping_file=str(mapping), learn_s=0.1)


@pytest.fixture
def session(graph: Spinning, mapping_file) -> Session:
    return Session(graph, mapping_file(command=HELD))


def test_joint_states_become_telemetry_with_its_description(session):
    session.publish_until(lambda: len(session.blocks) > 5, "blocks")
    description = description_from_message(session.descriptions[0])
    assert (description.actuator_id, description.sample_period) == ("flap", 1e-3)
    for before, after in pairwise(session.blocks):
        assert after.first_index == before.first_index + len(before.position)
    block = session.blocks[-1]
    assert (block.actuator_id, block.sample_period) == ("flap", 1e-3)
    assert list(block.command) == pytest.approx([GAIN * value for value in block.position])
    elapsed = 1e-9 * (stamp_from_message(block.header.stamp) - START_NS)
    # Speed of the motor: the speed of the joint over the gear ratio of 1/500.
    assert block.speed[0] == pytest.approx(500.0 * 0.2 * math.cos(20.0 * elapsed), rel=1e-9)
    assert session.task("input").level == OK
    assert session.task("input").values["lost"] == 0


@pytest.mark.parametrize(("step_s", "block_s"), [(0.01, 0.1), (1e-3, 0.02)])
def test_slower_joint_is_published_in_longer_blocks(session, step_s, block_s):
    session.step_s = step_s
    assert session.bridge._timer.timer_period_ns == 10_000_000
    session.publish_until(lambda: len(session.blocks) > 3, "blocks")
    assert session.bridge._timer.timer_period_ns == round(block_s * 1e9)


def test_temperature_of_a_topic_is_published_as_a_measured_cause(graph, mapping_file):
    temperature = {
        "topic": "/motor/temperature",
        "type": "sensor_msgs/msg/Temperature",
        "source": "temperature",
    }
    session = Session(graph, mapping_file(command=HELD, temperature=temperature))
    measured = graph.listen(MeasuredCauses, "/ema/measured_causes", STREAM)
    node = graph.node("sensor")
    sensor = node.create_publisher(Temperature, "/motor/temperature", 10)

    def warm() -> bool:
        message = Temperature(temperature=45.5)
        message.header.stamp = stamp_to_message(START_NS)
        sensor.publish(message)
        return bool(measured) and bool(session.blocks)

    session.publish_until(warm, "a measured temperature")
    assert measured[0].actuator_id == "flap"
    (cause,) = measured[0].causes
    assert (cause.name, cause.value, cause.unit) == ("winding_temperature", 25.5, "K")
    stamp_ns, causes = measured_from_message(measured[0])
    assert stamp_ns > START_NS
    assert checked_causes(causes)[0].sigma == 2.0


def test_reactivated_bridge_continues(session):
    session.publish_until(lambda: session.blocks, "the first block")
    assert session.bridge.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    count = len(session.descriptions)
    assert session.bridge.trigger_activate() == TransitionCallbackReturn.SUCCESS
    session.publish_until(lambda: len(session.descriptions) > count, "a description")


def test_column_that_becomes_nan_is_an_error_even_if_accepted(session):
    session.step_s = 0.01
    session.publish_until(lambda: session.task("mapping").level == OK and session.blocks, "OK")
    session.publish_until(lambda: session.task("mapping").level == ERROR, "the error", math.nan)
    mapping, incoming = session.task("mapping"), session.task("input")
    assert "current is not finite in" in mapping.message
    assert "current: repair its source or choose another source, or omit" in mapping.message
    assert incoming.level == ERROR
    assert "Hz received, but no telemetry is published: see mapping" in incoming.message
    of_flap = session.bridge._actuators["flap"].bridge
    of_flap.mapping = replace(of_flap.mapping, accept=("not_finite",))
    words = "no telemetry is published: not_finite: current is not finite"
    session.publish_until(lambda: words in session.task("input").message, words, math.nan)
    assert session.task("input").level == ERROR


def test_uncertain_defect_is_a_warning_and_withholds_no_telemetry(session, monkeypatch):
    session.publish_until(lambda: session.task("mapping").level == OK and session.blocks, "OK")
    evidence = OutOfRange(300.0, -130.0, 270.0, "K")
    defect = InputDefect(DefectKind.TEMPERATURE_RANGE, evidence, is_certain=False)
    monkeypatch.setattr(Bridge, "uncertain", property(lambda _: [defect]))
    count = len(session.blocks)
    session.publish_until(lambda: len(session.blocks) > count, "more telemetry")
    task = session.task("mapping")
    assert task.level == WARN
    assert (
        "to be checked again after more motion; telemetry is not withheld: temperature_range: "
        in task.message
    )


@pytest.mark.parametrize(
    ("needs_action", "accept", "level"),
    [(True, (), WARN), (True, ("command_position",), OK), (False, (), OK)],
)
def test_note_is_a_warning_only_while_it_needs_action(
    session, monkeypatch, needs_action, accept, level
):
    session.publish_until(lambda: session.task("mapping").level == OK and session.blocks, "OK")
    kind = DefectKind.COMMAND_POSITION
    note = InputDefect(kind, Factor(1.1, 4), is_error=False, needs_action=needs_action)
    notes = property(lambda _: [note], lambda _, value: None)
    monkeypatch.setattr(Bridge, "defects", notes, raising=False)
    of_flap = session.bridge._actuators["flap"].bridge
    of_flap.mapping = replace(of_flap.mapping, accept=accept)
    words = "command_position: the position moves 1.1 times as far as the command over 4 strokes"
    session.publish_until(lambda: words in session.task("mapping").message, words)
    assert session.task("mapping").level == level


def test_joint_without_a_command_is_published_without_a_command(graph, mapping_file, tmp_path):
    actuator = tmp_path / "joint.yaml"
    actuator.write_text("actuator_id: wheel\nserial_number: W-1\ndrive: unknown\n")
    mapping = mapping_file(command=None)
    bridge = graph.managed(
        BridgeNode, mapping_file=str(mapping), actuator_file=str(actuator), learn_s=0.1
    )
    session = Session(graph, mapping, bridge)
    session.publish_until(lambda: session.blocks and session.descriptions, "both")
    description = description_from_message(session.descriptions[0])
    assert not description.acquisition.command
    assert len(session.blocks[0].command) == 0
    assert len(session.blocks[0].position) > 0


def test_each_joint_of_a_mapping_is_an_actuator(graph: Spinning, mapping_file):
    """Two robots publish on one topic; the order of one robot's joints changes."""
    joints = {"shoulder": 0.0, "elbow": 1.0, "wrist": 2.0}
    names = [*joints, "gone"]
    bridge = bridge_of(graph, mapping_file(joint=None, joints=names, command=None))
    assert bridge.bring_up()
    descriptions = graph.listen(DescriptionMessage, "/ema/actuator_description", LATCHED_BY_MANY)
    blocks: list[TelemetryBlock] = graph.listen(TelemetryBlock, "/ema/telemetry", STREAM)
    states = graph.node("robots").create_publisher(JointState, STATES, 100)
    cycles, removed = count(), set[str]()

    def publish_and_ask() -> bool:
        i = next(cycles)
        arm = ["elbow", "shoulder"] if i % 3 else ["shoulder", "elbow"]
        arm = [name for name in arm if name not in removed]
        for listed in (arm, ["wrist"]):
            message = JointState(name=listed)
            message.header.stamp = stamp_to_message(START_NS + i * 5_000_000)
            message.position = [math.sin(0.02 * i + joints[name]) for name in listed]
            message.velocity = [4.0 * math.cos(0.02 * i + joints[name]) for name in listed]
            message.effort = [1.0 + joints[name] for name in listed]
            states.publish(message)
        return {item.actuator_id for item in blocks} & {
            item.actuator_id for item in descriptions
        } == set(joints)

    wait_for(publish_and_ask, "blocks of each joint")
    for block in blocks:
        shift = joints[block.actuator_id]
        start_s = 1e-9 * (stamp_from_message(block.header.stamp) - START_NS)
        angles = [math.sin(4.0 * (start_s + 5e-3 * i) + shift) for i in range(len(block.position))]
        assert list(block.position) == pytest.approx(angles, abs=1e-6)
        assert list(block.current) == pytest.approx([1.0 + shift] * len(angles))
    described = [description_from_message(message) for message in descriptions]
    assert {unit.actuator_id for unit in described} == set(joints)
    assert {(unit.drive, unit.sample_period) for unit in described} == {("unknown", 5e-3)}

    def input_of(joint: str) -> Task:
        return next(task for task in bridge.tasks() if task.name == f"{joint} input")

    assert input_of("elbow").level == OK, input_of("elbow").message
    wait_for(lambda: publish_and_ask() and input_of("gone").level == ERROR, "an error")
    assert "joint 'gone' is missing in all" in input_of("gone").message
    removed.add("elbow")
    wait_for(lambda: publish_and_ask() and input_of("elbow").level == ERROR, "an error")
    assert "joint 'elbow' is missing in the messages since 20" in input_of("elbow").message
    assert input_of("shoulder").level == OK, input_of("shoulder").message


def test_silent_topics_are_named_and_their_rates_fall(session):
    session.publish_until(lambda: session.task("input").level == OK and session.blocks, "OK")
    assert session.task("input").values["rate [Hz]"] > 0.0
    send, session.commands = session.commands, SimpleNamespace(publish=lambda message: None)
    held = "nothing received on /command for 1 s: command; last value held"
    session.publish_until(lambda: held in session.task("input").message, "the held command")
    session.commands = send
    session.publish_until(lambda: held not in session.task("input").message, "the command")
    send.publish(Float64())  # no position waits for a command after this
    wait_for(lambda: session.task("input").level == STALE, "STALE")
    task = session.task("input")
    assert "nothing received on /joint_states for 1 s: position, speed, current" in task.message
    assert task.values["rate [Hz]"] == 0.0
    # Samples that waited for the command are published after the last position.
    wait_for(lambda: session.task("input").values["published [Hz]"] == 0.0, "no rate")
    assert session.task("mapping").level == STALE
    # The first positions after the silence wait for a command.
    session.commands, levels = SimpleNamespace(publish=lambda message: None), set()

    def published() -> float:
        task = session.task("input")
        levels.add(task.level)
        return task.values["published [Hz]"]

    session.publish_until(published, "telemetry")
    assert ERROR not in levels
    session.publish_until(lambda: session.task("input").level == OK, "OK")


def test_silent_sensor_is_a_warning_although_its_value_is_held(graph, mapping_file):
    mapping = mapping_file(command=HELD, current=HELD, accept=["current_sign_reversed"])
    session = Session(graph, mapping)
    session.publish_until(lambda: session.task("input").level == OK and session.blocks, "OK")
    session.commands = SimpleNamespace(publish=lambda message: None)
    session.publish_until(lambda: "/command" in session.task("input").message, "the silence")
    task = session.task("input")
    assert (task.level, task.values["published [Hz]"] > 0.0) == (WARN, True)
    assert "nothing received on /command for 1 s: command, current" in task.message


def test_rate_that_changes_is_a_warning_until_it_is_learned(session):
    levels: dict[str, int] = {}

    def message() -> str:
        task = session.task("input")
        levels[task.message] = task.level
        return task.message

    session.publish_until(lambda: message() == "1000 Hz", "1000 Hz")
    session.step_s = 1e-2
    session.publish_until(lambda: message() == "100 Hz", "100 Hz")
    session.publish_until(lambda: session.blocks[-1].sample_period == 1e-2, "telemetry at 100 Hz")
    warned = [text for text, level in levels.items() if level == WARN]
    assert any("Hz received, telemetry has 1000 Hz" in text for text in warned), levels
    session.step_s = 1e-3
    session.publish_until(lambda: message() == "1000 Hz", "1000 Hz")
    assert levels["100 Hz"] == levels["1000 Hz"] == OK


def test_rate_that_cannot_be_learned_is_an_error_with_reason_and_remedy(session):
    assert session.task("input").level == WARN
    # The stamps stop increasing.
    session.step_s = 0.0
    session.publish_until(lambda: session.task("input").level == ERROR, "the error")
    message = session.task("input").message
    assert "do not increase: expected increasing stamps: set clock.source" in message


def test_position_that_disappears_from_messages_is_an_error(session):
    session.publish_until(lambda: session.blocks, "blocks")
    session.joint = "wing"
    session.publish_until(lambda: session.task("input").level == ERROR, "the error")
    message = session.task("input").message
    assert "no telemetry is published" in message
    assert "'flap_joint' is not in name, which has other, wing" in message
    session.publish_until(lambda: session.task("mapping").level == STALE, "nothing to check")


def test_topic_of_another_type_is_named(graph: Spinning, mapping_file):
    bridge = bridge_of(graph, mapping_file())
    graph.node("other").create_publisher(Float64, STATES, 10)
    assert bridge.bring_up()
    wait_for(lambda: bridge.tasks()[0].level == ERROR, "the error")
    assert (
        "topic /joint_states is published as std_msgs/msg/Float64: expected "
        "sensor_msgs/msg/JointState" in bridge.tasks()[0].message
    )


def test_type_that_is_not_installed_is_refused_with_the_package(graph: Spinning, mapping_file):
    command = {"topic": "/c", "type": "odrive_can/msg/ControlMessage", "source": "x"}
    bridge = bridge_of(graph, mapping_file(command=command))
    assert not bridge.bring_up()
    assert bridge.state == "unconfigured"
    assert "install package odrive_can (ros-jazzy-odrive-can)" in bridge._refused


class Robots:
    """Publisher of the joint states of robots, each on its topic, at stamps 5 ms apart."""

    def __init__(self, graph: Spinning, namespace: str = "/ema", **parameters: Any) -> None:
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        arguments: dict[str, Any] = {"namespace": namespace, "parameter_overrides": overrides}
        self.bridge = graph.add(made(BridgeNode, context=graph.context, **arguments))
        assert self.bridge.bring_up()
        self._node = graph.node("robots")
        self._publishers: dict[str, Any] = {}
        place = namespace.rstrip("/")
        self.descriptions = graph.listen(
            DescriptionMessage, f"{place}/actuator_description", LATCHED_BY_MANY
        )
        topic = f"{place}/telemetry"
        self.blocks: list[TelemetryBlock] = graph.listen(TelemetryBlock, topic, STREAM)
        self.robots = {"/joint_states": ["elbow", "wrist"], "/left/joint_states": ["elbow"]}
        self._number = 0

    def publish(self, *, effort: float = 1.0) -> None:
        self._number += 1
        angle, rate = math.sin(0.02 * self._number), 4.0 * math.cos(0.02 * self._number)
        for topic, names in self.robots.items():
            if topic not in self._publishers:
                self._publishers[topic] = self._node.create_publisher(JointState, topic, 100)
            listed = names[::-1] if self._number % 3 else names
            message = JointState(name=listed, position=[angle] * len(listed))
            message.header.stamp = stamp_to_message(START_NS + self._number * 5_000_000)
            message.velocity, message.effort = [rate] * len(listed), [effort] * len(listed)
            self._publishers[topic].publish(message)

    def wait_for_blocks(self, names: set[str], **columns: float) -> None:
        def publish_and_ask() -> bool:
            self.publish(**columns)
            return {item.actuator_id for item in self.blocks} >= names

        wait_for(publish_and_ask, f"blocks of {names}")

    @property
    def joints(self) -> Task:
        return next(task for task in self.bridge.tasks() if task.name == "joints")


def test_without_a_mapping_all_joints_of_all_robots_are_bridged(graph: Spinning):
    robots = Robots(graph)
    names = {"elbow", "wrist", "left/elbow"}
    robots.wait_for_blocks(names)

    def described() -> dict[str, DescriptionMessage]:
        return {message.actuator_id: message for message in robots.descriptions}

    wait_for(lambda: set(described()) == names, "the descriptions")
    assert description_from_message(described()["wrist"]).drive == "unknown"
    assert (robots.joints.level, robots.joints.values["joints"]) == (OK, 3)
    # A joint that appears later is bridged too, and the other joints continue.
    robots.robots["/left/joint_states"].append("gripper")
    before = len([item for item in robots.blocks if item.actuator_id == "wrist"])
    robots.wait_for_blocks({"left/gripper"})
    assert len([item for item in robots.blocks if item.actuator_id == "wrist"]) > before
    assert len([message for message in robots.descriptions if message.actuator_id == "wrist"]) == 1


def test_bridge_in_the_root_namespace_finds_all_joints(graph: Spinning):
    robots = Robots(graph, "/")
    robots.wait_for_blocks({"elbow", "wrist", "left/elbow"})


def test_joint_states_of_a_node_that_publishes_telemetry_are_not_bridged(graph: Spinning):
    node = graph.node("actuator", "/")
    telemetry = node.create_publisher(TelemetryBlock, "telemetry", STREAM)
    robots = Robots(graph, "/")
    wait_for(lambda: robots.bridge.count_publishers("/telemetry") == 2, "the telemetry")
    node.create_publisher(JointState, "simulated/joint_states", 100)
    wait_for(lambda: robots.bridge.count_publishers("/simulated/joint_states"), "its joint states")
    robots.wait_for_blocks({"elbow", "wrist", "left/elbow"})
    searched = robots.joints.values["joint state topics"]
    assert set(searched.split(", ")) == {"/joint_states", "/left/joint_states"}
    # A node without telemetry counts as a robot.
    node.destroy_publisher(telemetry)
    wait_for(
        lambda: "/simulated/joint_states" in robots.joints.values["joint state topics"],
        "the joint states of a robot",
    )


def test_joints_beyond_the_limit_are_named_and_not_bridged(graph: Spinning):
    robots = Robots(graph, most_actuators=1)
    robots.robots = {"/joint_states": ["elbow"]}
    robots.wait_for_blocks({"elbow"})
    robots.robots["/left/joint_states"] = ["wrist", "hand"]
    wait_for(lambda: (robots.publish(), "most_actuators" in robots.joints.message)[1], "the limit")
    text = "the limit most_actuators = 1 is reached: left/hand, left/wrist ignored"
    assert text in robots.joints.message
    assert robots.joints.level == WARN
    assert {item.actuator_id for item in robots.blocks} == {"elbow"}


def test_joint_continues_from_another_topic_if_its_topic_dies(graph: Spinning):
    robots = Robots(graph)
    robots.robots = {"/joint_states": ["elbow"], "/raw_joint_states": ["elbow"]}
    robots.wait_for_blocks({"elbow"})
    del robots.robots["/joint_states"]
    mapping = lambda: robots.bridge._actuators["elbow"].bridge.mapping  # noqa: E731
    wait_for(
        lambda: (robots.publish(), mapping().position.topic == "/raw_joint_states")[1],
        "another topic",
    )
    robots.blocks.clear()
    robots.wait_for_blocks({"elbow"})


def test_payload_of_a_robot_is_in_the_telemetry_of_its_joints(graph: Spinning):
    robots = Robots(graph)
    robots.wait_for_blocks({"wrist", "left/elbow"})
    payload = graph.node("gripper").create_publisher(Bool, "/left/payload", LATCHED)
    for held in (True, False):
        payload.publish(Bool(data=held))
        wait_for(
            lambda held=held: (
                robots.publish(),
                any(set(block.payload) == {float(held)} for block in robots.blocks[-20:]),
            )[1],
            "the payload",
        )
    having = {block.actuator_id for block in robots.blocks if len(block.payload)}
    assert having == {"left/elbow"}
    assert len(robots.blocks[-1].position) > 0


def test_joint_without_effort_is_bridged_and_named(graph: Spinning):
    robots = Robots(graph)
    robots.wait_for_blocks({"wrist"}, effort=0.0)
    assert robots.joints.level == WARN
    assert "no effort is published: elbow, left/elbow, wrist" in robots.joints.message
    first = next(block for block in robots.blocks if block.actuator_id == "wrist")
    assert len(first.current) == 0
    robots.blocks.clear()
    wait_for(
        lambda: (robots.publish(), any(len(block.current) for block in robots.blocks))[1],
        "telemetry with effort",
    )
    wait_for(lambda: (robots.publish(), robots.joints.level == OK)[1], "all joints with effort")


def test_bridge_without_joint_states_warns(graph: Spinning):
    bridge = graph.managed(BridgeNode)
    assert bridge.bring_up()
    [task] = bridge.tasks()
    assert (task.level, task.message) == (WARN, "no publisher of joint states")
    assert bridge.counts().joint_search == task.message
