# SPDX-License-Identifier: Apache-2.0
"""``ema check`` on the topics of a running robot."""

import json
import signal
import subprocess
import threading
import time
from collections.abc import Iterator

import pytest
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import JointState, Temperature

from ema_ros.stamps import stamp_to_message

from ..inputs.joint_motion import TAU, moves
from ..waiting import DEADLINE_S, started
from .spinning import ros_context

RATE_HZ = 100.0
NAMES = ("hip", "knee")
TRAVELS = (0.5, 0.7)


@pytest.fixture
def context() -> Iterator[Context]:
    with ros_context() as context:
        yield context


@pytest.fixture
def robot(context: Context) -> Iterator[None]:
    """Publish two joints in alternating order, with the stamps of their motion."""
    joints = [moves(60.0, RATE_HZ, travel, 3)[0] for travel in TRAVELS]
    node = Node("robot", context=context)
    publisher = node.create_publisher(JointState, "/joint_states", 10)
    ending = threading.Event()

    def publish() -> None:
        start_ns, row = time.time_ns(), 0
        while not ending.wait(1.0 / RATE_HZ):
            order = [0, 1] if row % 2 else [1, 0]
            message = JointState(name=[NAMES[k] for k in order])
            # Stamps follow the motion, even if a busy machine publishes late.
            stamp_ns = start_ns + round(1e9 * row / RATE_HZ)
            message.header.stamp = stamp_to_message(stamp_ns)
            message.position = [float(joints[k]["position"][row]) for k in order]
            message.velocity = [float(TAU * joints[k]["speed"][row]) for k in order]
            message.effort = [float(joints[k]["current"][row]) for k in order]
            publisher.publish(message)
            row = (row + 1) % len(joints[0]["position"])

    thread = threading.Thread(target=publish)
    thread.start()
    yield
    ending.set()
    thread.join()
    node.destroy_node()


@pytest.mark.usefixtures("robot")
def test_joints_of_a_running_robot_are_examined(ema):
    result = ema("check", "/joint_states", "--seconds", "8", "--json")
    assert result.exit_code == 0, result.output
    joints = {joint["joint"]: joint for joint in json.loads(result.stdout)[0]["joints"]}
    assert joints.keys() == set(NAMES)
    for name, travel in zip(NAMES, TRAVELS, strict=True):
        joint = joints[name]
        assert joint["timing"]["rate_hz"] == pytest.approx(RATE_HZ, rel=0.01)
        assert joint["motion"]["travel"] == pytest.approx(travel, rel=0.02)
        assert {item["quantity"] for item in joint["columns"]} == {"position", "speed", "current"}
        able = {item["ability"] for item in joint["abilities"] if not item["needs"]}
        assert "friction" in able
        assert "tracking_lag" not in able


@pytest.mark.usefixtures("robot")
def test_interrupt_ends_the_listening_and_reports(tmp_path):
    words = ["ema", "check", "/joint_states", "--seconds", "600", "-o", tmp_path / "m.yaml"]
    with started(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert "Ctrl-C ends it" in process.stderr.readline()
        time.sleep(4.0)  # some motion; the interrupt may come at any time
        process.send_signal(signal.SIGINT)
        output, error = process.communicate(timeout=DEADLINE_S)
    assert process.returncode in (0, 3), error
    assert "joint knee" in output
    assert "topic: /joint_states" in (tmp_path / "m.yaml").read_text()


def test_topic_without_a_publisher_or_message_is_refused(ema, context):
    result = ema("check", "/nowhere")
    assert result.exit_code == 1
    assert "topic /nowhere has no publisher; published topics with joints: none" in result.stderr
    node = Node("silent", context=context)
    node.create_publisher(JointState, "/joint_states", 10)
    node.create_publisher(Temperature, "/oil", 10)
    try:
        silent = ema("check", "/joint_states", "--seconds", "0.5")
        assert silent.exit_code == 1
        assert "has a publisher, but no message was received in 0.5 s" in silent.stderr
        temperature = ema("check", "/oil")
        assert temperature.exit_code == 1
        assert "has type sensor_msgs/msg/Temperature: expected one of" in temperature.stderr
        nowhere = ema("check", "/nowhere")
        assert "published topics with joints: /joint_states" in nowhere.stderr
    finally:
        node.destroy_node()
