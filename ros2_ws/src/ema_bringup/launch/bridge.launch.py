# SPDX-License-Identifier: Apache-2.0
"""A monitor, with telemetry from third-party topics.

ros2 launch ema_bringup bridge.launch.py mapping_file:=/path/mapping.yaml
"""

import sys
from pathlib import Path

from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription

sys.path.insert(0, str(Path(__file__).parent))
import ema_launch_arguments as ema


def generate_launch_description() -> LaunchDescription:
    """Return the launch description with the nodes and their arguments."""
    return ema.launch(
        __file__,
        _nodes,
        ("bridge", "monitor"),
        mapping_file=(ema.AS_CONFIGURED, "YAML file that maps topics to telemetry"),
        actuator_file=(ema.AS_CONFIGURED, "actuator file, whose description the bridge publishes"),
    )


def _nodes(context: LaunchContext) -> list[Node]:
    files = ema.chosen(context, "mapping_file", "actuator_file")
    return [ema.node(context, "bridge", "ema_bags", parameters=files), *ema.monitors(context)]
