"""Simulated actuator, monitor, dashboard and, if a bag is named, recorder.

ros2 launch ema_bringup ema.launch.py bag:=worn_flap
"""

import sys
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

sys.path.insert(0, str(Path(__file__).parent))
import ema_launch_arguments as ema


def generate_launch_description() -> LaunchDescription:
    """Return the nodes, with their arguments."""
    arguments = [
        # A simulated actuator is a new unit at each start.
        *ema.common_arguments(history_folder=""),
        DeclareLaunchArgument(
            "bag",
            default_value="",
            description="bag to record; empty: no recorder; if it fails, all end",
        ),
        *ema.parameter_files("actuator", "monitor", "dashboard", "recorder"),
    ]
    check = ema.check_arguments(__file__, arguments)
    return LaunchDescription([*arguments, check, OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list[Node]:
    nodes = [
        ema.node(context, "actuator", "ema_sim"),
        ema.monitor(context),
        ema.node(context, "dashboard", "ema_dashboard"),
    ]
    bag = ema.value_of(context, "bag")
    if bag:
        nodes.append(
            ema.node(
                context, "recorder", "ema_recording", parameters={"output": bag}, ends_all=True
            )
        )
    return nodes
