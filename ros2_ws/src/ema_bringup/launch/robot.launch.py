# SPDX-License-Identifier: Apache-2.0
"""A simulated robot arm.

ros2 launch ema_bringup robot.launch.py namespace:=/left
"""

from launch_ros.actions import Node

from ema_bringup import launch_arguments as ema
from launch import LaunchContext, LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Return the launch description with the node and its arguments."""
    return ema.launch(__file__, _nodes, ("robot",))


def _nodes(context: LaunchContext) -> list[Node]:
    return [ema.node(context, "robot", "ema_sim")]
