"""A monitor, and its telemetry from the topics of another make.

ros2 launch ema_bringup bridge.launch.py mapping_file:=/path/mapping.yaml
"""

import sys
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

sys.path.insert(0, str(Path(__file__).parent))
import ema_launch_arguments as ema

_FILES = ("mapping_file", "actuator_file")


def generate_launch_description() -> LaunchDescription:
    """Return the nodes, with their arguments."""
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
            description="description of the actuator, which the bridge publishes",
        ),
        *ema.parameter_files("bridge", "monitor"),
    ]
    check = ema.check_arguments(__file__, arguments)
    return LaunchDescription([*arguments, check, OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list[Node]:
    given = {name: ema.value_of(context, name) for name in _FILES}
    chosen = {name: value for name, value in given.items() if value != ema.AS_CONFIGURED}
    return [
        ema.node(context, "bridge", "ema_inputs", parameters=chosen),
        ema.monitor(context),
    ]
