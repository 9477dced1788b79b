# SPDX-License-Identifier: Apache-2.0
"""Collection of joint messages from topics of a running robot."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ema_bags.inputs.joint_messages import KINDS, is_read
from ema_bags.inputs.joint_topics import JointTopics
from ema_bags.message_type import message_class
from ema_bags.qos import common_offer
from ema_cli.processes.stop_request import StopRequest, deferred_signals

_DISCOVERY_S: Final = 3.0
_DEPTH: Final = 5000
_SPIN_S: Final = 0.1
_NAME: Final = "ema_check"


def collect(topics: Sequence[str], seconds: float, ready: Callable[[], None]) -> JointTopics:
    """Subscribe to topics and return the messages received within a time, or until Ctrl-C.

    Parameters
    ----------
    topics
        Full names of the topics.
    seconds
        Time to receive messages after the subscription [s].
    ready
        Called once the topics are subscribed.

    Raises
    ------
    ValueError
        If a topic has no publisher, its type has no joints, or no message is received.
    """
    context = Context()
    rclpy.init(
        args=["--ros-args", "--enclave", f"/{_NAME}/{_NAME}"],
        context=context,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    node = Node(_NAME, namespace=f"/{_NAME}", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    collected = JointTopics()
    try:
        with deferred_signals() as stop:
            kinds = {topic: _kind_of(node, executor, topic, stop) for topic in topics}
            for topic, kind in kinds.items():
                publishers = node.get_publishers_info_by_topic(topic)
                quality = common_offer([item.qos_profile for item in publishers], _DEPTH)
                receive: Any = partial(_receive, collected, topic, kind)
                node.create_subscription(message_class(kind), topic, receive, quality)
            ready()
            deadline = time.monotonic() + seconds
            while time.monotonic() < deadline and not stop:
                executor.spin_once(timeout_sec=_SPIN_S)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    if silent := [topic for topic in topics if topic not in collected.topics]:
        raise ValueError(
            f"topic {silent[0]} has a publisher, but no message was received in {seconds:g} s: "
            "check that the robot is running"
        )
    return collected


def _kind_of(node: Node, executor: SingleThreadedExecutor, topic: str, stop: StopRequest) -> str:
    """Wait for a publisher of a topic and return the message type.

    Raises
    ------
    ValueError
        If no publisher appears within 3 s, or the message type has no joints.
    """
    deadline = time.monotonic() + _DISCOVERY_S
    while time.monotonic() < deadline and not stop:
        if publishers := node.get_publishers_info_by_topic(topic):
            kind = publishers[0].topic_type
            if not is_read(topic, kind):
                raise ValueError(
                    f"topic {topic} has type {kind}: expected one of {', '.join(sorted(KINDS))}"
                )
            return str(kind)
        executor.spin_once(timeout_sec=_SPIN_S)
    present = sorted(
        name
        for name, types in node.get_topic_names_and_types()
        if KINDS & set(types) and node.count_publishers(name)
    )
    raise ValueError(
        f"topic {topic} has no publisher; published topics with joints: "
        f"{', '.join(present) or 'none'}; --network includes other machines"
    )


def _receive(collected: JointTopics, topic: str, kind: str, message: Any, information: Any) -> None:
    sent_ns = int(information.get("source_timestamp") or 0)
    received_ns = int(information.get("received_timestamp") or time.time_ns())
    collected.add(topic, kind, message, sent_ns, received_ns)
