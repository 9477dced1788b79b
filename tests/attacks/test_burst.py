# SPDX-License-Identifier: Apache-2.0
"""Nodes release their memory after a burst of large messages."""

import re
from array import array
from pathlib import Path

import pytest
from rclpy.node import Node
from rclpy.serialization import serialize_message

from ema_cli.processes.bringup import program
from ema_ros.topics import ACTUATOR_TOPICS, NAMESPACE, TELEMETRY

from ..ros.spinning import ros_context
from ..waiting import started, wait_for


@pytest.mark.slow
@pytest.mark.parametrize("name", ["monitor", "recorder"])
def test_node_releases_its_memory_after_a_burst(tmp_path: Path, name: str):
    message_class, qos = ACTUATOR_TOPICS[TELEMETRY]
    # The columns differ in length, so the node receives the message and discards it.
    large = serialize_message(message_class(command=array("d", bytes(16_000_000))))
    arguments = ["--ros-args", "-r", f"__ns:={NAMESPACE}", "-p", f"output:={tmp_path / 'bag'}"]
    command = [program(name), *arguments[: None if name == "recorder" else 3]]
    with ros_context() as context, started(command) as process:
        publisher = Node("source", context=context).create_publisher(
            message_class, f"{NAMESPACE}/{TELEMETRY}", qos
        )

        def memory_mb(name: str) -> int:
            text = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8")
            return int(re.findall(rf"{name}:\s+(\d+)", text)[0]) // 1024

        wait_for(publisher.get_subscription_count, "the subscription")
        before = memory_mb("VmRSS")
        for _ in range(30):
            publisher.publish(large)
        wait_for(lambda: memory_mb("VmHWM") > before + 250, "the burst")
        wait_for(lambda: memory_mb("VmRSS") < before + 100, "the memory")
