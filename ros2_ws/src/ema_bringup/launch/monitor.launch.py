"""The monitor alone, for actuators that publish their own telemetry.

ros2 launch ema_bringup monitor.launch.py calibration_file:=/path/calibration.yaml

With ``monitors:=N`` there are N of them, and each follows a share of the actuators.
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
            "actuator_file",
            default_value=ema.AS_CONFIGURED,
            description="description of an actuator that publishes none",
        ),
        ema.monitors_argument(),
        *ema.parameter_files("monitor"),
    ]
    check = ema.check_arguments(__file__, arguments)
    return LaunchDescription([*arguments, check, OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list[Node]:
    file = ema.value_of(context, "actuator_file")
    return ema.monitors(context, **({} if file == ema.AS_CONFIGURED else {"actuator_file": file}))
