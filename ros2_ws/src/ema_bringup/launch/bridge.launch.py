# SPDX-License-Identifier: Apache-2.0
"""A monitor, with telemetry from third-party topics.

ros2 launch ema_bringup bridge.launch.py mapping_file:=/path/mapping.yaml
"""

from launch_ros.actions import Node

from ema_bringup import launch_arguments as ema
from launch import LaunchContext, LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Return the launch description with the nodes and their arguments."""
    return ema.launch(
        __file__,
        _nodes,
        ("bridge", "monitor"),
        mapping_file=("", "YAML file that maps topics to telemetry; empty: as in bridge_params"),
        actuator_file=(
            "",
            "actuator file, whose description the bridge publishes; empty: as in bridge_params",
        ),
    )


def _nodes(context: LaunchContext) -> list[Node]:
    files = ema.chosen(context, "mapping_file", "actuator_file")
    return [ema.node(context, "bridge", "ema_bags", parameters=files), *ema.monitors(context)]
