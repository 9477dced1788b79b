"""The bridge between a robot of another make and the monitor, in processes of their own."""

import array
import math
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from ema_bags.inputs.bridge_node import BridgeNode
from ema_core.description import ActuatorDescription
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_interfaces.msg import TelemetryBlock
from ema_monitor import calibrate, find_windows
from ema_ros.executor import NodeExecutor
from ema_ros.messages import description_from_message
from ema_ros.stamps import stamp_from_message, stamp_to_message
from ema_ros.status import ERROR, OK, Task
from ema_ros.topics import LATCHED, STREAM
from ema_sim import simulate

from ..waiting import wait_for
from .graph import Graph
from .spinning import fail

ROBOT = Path(__file__).with_name("robot.py")
STATES = "/joint_states"
JOINT_STATE = {
    "joint": "flap_joint",
    "position": {"topic": STATES, "type": "sensor_msgs/msg/JointState", "source": "position"},
    "speed": {"topic": STATES, "source": "velocity", "shaft": "user"},
    "current": {"topic": STATES, "source": "effort"},
    "command": {"topic": "/command", "source": "data[1]", "between": "hold"},
}
FRICTION = 0.25
START_NS = 1_700_000_000_000_000_000


@pytest.fixture
def mapping_file(tmp_path):
    """Write a mapping with sections changed, or left out where None."""

    def write(**changes):
        content = {k: v for k, v in (JOINT_STATE | changes).items() if v is not None}
        path = tmp_path / "mapping.yaml"
        path.write_text(yaml.safe_dump(content))
        return path

    return write


def calibrated(rate_hz: int, path: Path) -> ActuatorDescription:
    """Write a calibration of the healthy actuator at a rate."""
    description = ActuatorDescription(sample_period=1.0 / rate_hz)
    healthy = simulate({}, 5, description=description)
    calibrate(find_windows(healthy, description), description).save(path)
    return description


@pytest.mark.long
def test_robot_with_joint_states_is_estimated_live(mapping_file, tmp_path):
    rate_hz = 1000
    calibrated(rate_hz, tmp_path / "calibration.yaml")
    mapping = mapping_file()
    with Graph() as graph:
        graph.start("monitor", calibration_file=tmp_path / "calibration.yaml")
        graph.start("bridge", mapping_file=mapping)
        for name in ("monitor", "bridge"):
            graph.wait_for(lambda name=name: active(graph, name), f"{name} is active")
        arguments = [str(rate_hz), "3", str(FRICTION)]
        graph.start_other("robot", [sys.executable, ROBOT, *arguments])
        graph.wait_for(lambda: len(graph.estimates) >= 2, "two estimates")
        for estimate in graph.estimates[:2]:
            assert estimate.valid, estimate.reason
            # Of the range, as the accuracy of means over 1 or 2 ms is (docs/accuracy.md).
            assert abs(estimate.faults.friction - FRICTION) < 0.01
        _, message, values = graph.status[status_of(graph, "input")]
        assert f"{rate_hz} Hz" in graph.log("bridge").read_text()
        assert (values["lost"], values["withheld"], values["clock jumps"]) == ("0", "0", "0")
        assert graph.status[status_of(graph, "mapping")][0] == 0, message
        assert graph.stop("bridge") == 0


def status_of(graph: Graph, task: str) -> str:
    """The name of a status of the bridge, whatever it begins with."""
    return next(name for name in graph.status if "bridge" in name and name.endswith(f": {task}"))


def active(graph: Graph, node: str) -> bool:
    return any(
        node in name and name.endswith(": lifecycle") and item[1] == "active"
        for name, item in graph.status.items()
    )


class Session:
    """A bridge in this process, and a node beside it that publishes and listens."""

    def __init__(self, bridge: BridgeNode, other: Node) -> None:
        self.bridge = bridge
        self.descriptions: list[DescriptionMessage] = []
        self.blocks: list[TelemetryBlock] = []
        other.create_subscription(
            DescriptionMessage, "/ema/actuator_description", self.descriptions.append, LATCHED
        )
        other.create_subscription(TelemetryBlock, "/ema/telemetry", self.blocks.append, STREAM)
        # Best effort, as sensors publish: the bridge asks for no more than is offered.
        best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.states = other.create_publisher(JointState, STATES, best_effort)
        self.commands = other.create_publisher(Float64, "/command", 10)
        self.joint = "flap_joint"
        self._number = 0

    def publish_next(self, **factors: float) -> None:
        """Publish the next of samples at 1 kHz of a sine that both follow."""
        self._number += 1
        t = self._number * 1e-3
        angle, rate = 0.01 * math.sin(20.0 * t), 0.2 * math.cos(20.0 * t)
        rows = {"position": angle, "velocity": rate, "effort": math.sin(t)}
        message = JointState(name=["other", self.joint])
        message.header.stamp = stamp_to_message(START_NS + round(t * 1e9))
        for name, value in rows.items():
            setattr(message, name, array.array("d", [0.0, value * factors.get(name, 1.0)]))
        self.commands.publish(Float64(data=angle))
        self.states.publish(message)

    def publish_until(self, condition: Callable[[], Any], what: str, **factors: float) -> None:
        def publish_and_ask() -> Any:
            self.publish_next(**factors)
            return condition()

        wait_for(publish_and_ask, what)

    def task(self, name: str) -> Task:
        return next(item for item in self.bridge.tasks() if item.name == name)


@pytest.fixture
def make_bridge(make_node) -> Callable[[Path], BridgeNode]:
    """Make a bridge with a mapping; it is ended after what serves it."""

    def make(path: Path) -> BridgeNode:
        given = {"mapping_file": str(path), "learn_s": 0.1}
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        return make_node(kind=BridgeNode, parameter_overrides=overrides)

    return make


@pytest.fixture
def session(context, make_node, make_bridge, spin, mapping_file) -> Session:
    """A bridge that is up, with a mapping of JointState and Float64."""
    command = {"topic": "/command", "source": "data", "between": "hold"}
    bridge = make_bridge(mapping_file(command=command))
    other = make_node("other")
    spin(NodeExecutor(fail, context=context), bridge, other)
    assert bridge.bring_up()
    return Session(bridge, other)


def test_joint_states_become_telemetry_with_its_description(session):
    session.publish_until(lambda: len(session.blocks) > 5, "blocks")
    description = description_from_message(session.descriptions[0])
    assert (description.actuator_id, description.sample_period) == ("flap", 1e-3)
    for before, after in pairwise(session.blocks):
        assert after.first_index == before.first_index + len(before.position)
    block = session.blocks[-1]
    assert (block.actuator_id, block.sample_period) == ("flap", 1e-3)
    assert list(block.command) == pytest.approx(list(block.position))
    elapsed = 1e-9 * (stamp_from_message(block.header.stamp) - START_NS)
    # Speed of the motor: that of the joint over the gear ratio of 1/500.
    assert block.speed[0] == pytest.approx(500.0 * 0.2 * math.cos(20.0 * elapsed), rel=1e-9)
    assert session.task("input").level == OK
    assert session.task("input").values["lost"] == 0


def test_bridge_that_is_activated_again_goes_on(session):
    session.publish_until(lambda: session.blocks, "the first block")
    assert session.bridge.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
    count = len(session.descriptions)
    assert session.bridge.trigger_activate() == TransitionCallbackReturn.SUCCESS
    session.publish_until(lambda: len(session.descriptions) > count, "a description")


def test_defect_withholds_telemetry_and_is_named_in_the_status(session):
    session.publish_until(lambda: session.bridge.tasks()[1].level == ERROR, "error", effort=0.0)
    task = session.task("mapping")
    assert "telemetry is withheld: current_zero: current is 0 in all" in task.message
    assert "leave current out" in task.values["current_zero"]
    session.publish_until(lambda: session.bridge.tasks()[1].level != ERROR, "the end of it")


def test_column_that_becomes_nan_makes_input_and_mapping_errors_that_name_it(session):
    session.publish_until(lambda: session.task("mapping").level == OK and session.blocks, "OK")
    session.publish_until(
        lambda: session.task("mapping").level == ERROR, "the error", effort=math.nan
    )
    mapping, incoming = session.task("mapping"), session.task("input")
    assert "current is not a finite number in" in mapping.message
    assert "current: repair its source or choose another one, or leave" in mapping.message
    assert incoming.level == ERROR
    assert "Hz received, no telemetry is published: see mapping" in incoming.message


def test_position_that_is_not_in_the_messages_any_more_is_an_error_with_the_reason(session):
    session.publish_until(lambda: session.blocks, "blocks")
    session.joint = "wing"
    session.publish_until(lambda: session.task("input").level == ERROR, "the error")
    message = session.task("input").message
    assert "no telemetry is published" in message
    assert "'flap_joint' is not in name, which has other, wing" in message


def test_topic_of_another_type_is_named(context, make_node, make_bridge, spin, mapping_file):
    bridge, other = make_bridge(mapping_file()), make_node("other")
    other.create_publisher(Float64, STATES, 10)
    spin(NodeExecutor(fail, context=context), bridge, other)
    assert bridge.bring_up()
    wait_for(lambda: bridge.tasks()[0].level == ERROR, "the error")
    assert (
        "topic /joint_states is published as std_msgs/msg/Float64: expected "
        "sensor_msgs/msg/JointState" in bridge.tasks()[0].message
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"command": {"topic": "/c", "type": "odrive_can/msg/ControlMessage", "source": "x"}},
            "install package odrive_can (ros-jazzy-odrive-can)",
        ),
        ({"position": {"source": "p"}}, "expected a topic for every quantity"),
        ({"command": None}, "neither of command and error given"),
    ],
)
def test_mapping_that_cannot_work_is_refused_with_the_reason(
    make_bridge, mapping_file, changes, words
):
    bridge = make_bridge(mapping_file(**changes))
    assert not bridge.bring_up()
    assert bridge.state == "unconfigured"
    assert words in bridge._refused
