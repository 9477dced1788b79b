# SPDX-License-Identifier: Apache-2.0
"""The monitor alone, for actuators that publish their own telemetry.

ros2 launch ema_bringup monitor.launch.py calibration_file:=/path/calibration.yaml

With ``monitors:=N``, N monitors share the actuators.
"""

import sys
from pathlib import Path

from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription

sys.path.insert(0, str(Path(__file__).parent))
import ema_launch_arguments as ema


def generate_launch_description() -> LaunchDescription:
    """Return the launch description with the node and its arguments."""
    return ema.launch(
        __file__,
        _nodes,
        ("monitor",),
        actuator_file=(
            ema.AS_CONFIGURED,
            "actuator file for actuators that do not publish a description",
        ),
        monitors=ema.MONITORS,
    )


def _nodes(context: LaunchContext) -> list[Node]:
    count = ema.value_of(context, "monitors")
    return ema.monitors(context, count, **ema.chosen(context, "actuator_file"))
