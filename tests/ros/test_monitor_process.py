# SPDX-License-Identifier: Apache-2.0
"""The process of a monitor ends cleanly."""

import signal
from functools import partial
from pathlib import Path

from rclpy.action.client import ActionClient

from ema_interfaces.action import IdentifyFaults
from ema_interfaces.srv import Calibrate
from ema_ros.messages import description_to_message, telemetry_to_message
from ema_ros.topics import ACTUATOR_TOPICS, DESCRIPTION, TELEMETRY

from .graph import Graph
from .monitor_session import FLAP, Source
from .spinning import where_it_spins


def test_process_ends_cleanly_during_an_identification_with_waiting_calls(tmp_path: Path):
    task = "/ema/monitor: flap telemetry"
    with Graph(tmp_path) as graph:
        node = graph.node
        publishers = {
            name: node.create_publisher(message_class, f"/ema/{name}", qos)
            for name, (message_class, qos) in ACTUATOR_TOPICS.items()
        }
        publishers[DESCRIPTION].publish(description_to_message(FLAP))
        # A search with ten million evaluations takes minutes.
        graph.start("monitor", algorithm="pso", budget=10_000_000)
        calibrate = node.create_client(Calibrate, "/ema/monitor/calibrate")
        graph.wait_for(calibrate.service_is_ready, "the monitor")
        graph.wait_for(lambda: task in graph.status, "the description")
        for block in Source().cycle():
            publishers[TELEMETRY].publish(telemetry_to_message(block, FLAP.actuator_id))
        graph.wait_for(lambda: graph.status[task].values.get("windows") == "1", "the window")
        calibrate.call_async(Calibrate.Request(windows=5))
        identify = ActionClient(node, IdentifyFaults, "/ema/monitor/identify_faults")
        graph.wait_for(identify.server_is_ready, "the action")
        for later in (False, True):
            goal = IdentifyFaults.Goal(next_window=later)
            sent = where_it_spins(node, partial(identify.send_goal_async, goal))
            graph.wait_for(sent.done, "the goal")
        # A launcher may send a signal twice.
        graph.processes["monitor"].send_signal(signal.SIGINT)
        assert graph.stop("monitor") == 0, graph.log("monitor").read_text()
        assert graph.failures() == []
        where_it_spins(node, identify.destroy)
