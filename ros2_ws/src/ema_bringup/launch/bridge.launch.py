"""Telemetry of an actuator from the topics of another make, beside a monitor.

ros2 launch ema_bringup bridge.launch.py mapping_file:=/path/mapping.yaml
"""

import sys
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

sys.path.insert(0, str(Path(__file__).parent))
import ema_launch_arguments as ema


def generate_launch_description() -> LaunchDescription:
    """Return the node, with its arguments."""
    arguments = [
        *ema.common_arguments(),
        DeclareLaunchArgument(
            "mapping_file",
            default_value=ema.AS_CONFIGURED,
            description="mapping of topics to telemetry",
        ),
        DeclareLaunchArgument(
            "actuator_file",
            default_value=ema.AS_CONFIGURED,
            description="description of the actuator",
        ),
        *ema.parameter_files("bridge"),
    ]
    check = ema.check_arguments(__file__, arguments)
    return LaunchDescription([*arguments, check, OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list[Node]:
    given = {name: ema.value_of(context, name) for name in ("mapping_file", "actuator_file")}
    chosen = {name: value for name, value in given.items() if value != ema.AS_CONFIGURED}
    return [ema.node(context, "bridge", "ema_inputs", parameters=chosen)]
