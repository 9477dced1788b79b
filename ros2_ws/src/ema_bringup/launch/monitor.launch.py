# SPDX-License-Identifier: Apache-2.0
"""The monitor alone, for actuators that publish their own telemetry.

ros2 launch ema_bringup monitor.launch.py calibration_file:=/path/calibration.yaml

With ``monitors:=N``, N monitors share the actuators.
"""

from launch_ros.actions import Node

from ema_bringup import launch_arguments as ema
from launch import LaunchContext, LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Return the launch description with the node and its arguments."""
    return ema.launch(
        __file__,
        _nodes,
        ("monitor",),
        actuator_file=(
            "",
            "actuator file for actuators that do not publish a description; empty: as in "
            "monitor_params",
        ),
        monitors=ema.MONITORS,
    )


def _nodes(context: LaunchContext) -> list[Node]:
    count = ema.value_of(context, "monitors")
    return ema.monitors(context, count, **ema.chosen(context, "actuator_file"))
