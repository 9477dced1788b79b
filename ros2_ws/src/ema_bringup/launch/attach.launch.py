# SPDX-License-Identifier: Apache-2.0
"""Bridge, monitor, recorder and dashboard for all joints of the robots in the graph.

ros2 launch ema_bringup attach.launch.py
"""

from typing import Any

from launch_ros.actions import Node

from ema_bringup import launch_arguments as ema
from launch import LaunchContext, LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Return the launch description with the nodes and their arguments."""
    return ema.launch(
        __file__,
        _nodes,
        ("bridge", "monitor", "recorder", "dashboard"),
        attach_params=(ema.shipped_file("attach"), "parameters of all nodes of this launch file"),
        effort_unit=("N.m", "unit of the effort: N.m, A or N"),
        accept_after=(
            "0",
            "healthy records after which a baseline is accepted; 0: a person accepts",
        ),
        recordings=("recordings", "folder of the recordings of level changes; it must be new"),
    )


def _nodes(context: LaunchContext) -> list[Node]:
    file = ema.value_of(context, "attach_params")
    parameters: dict[str, tuple[str, dict[str, Any]]] = {
        "bridge": ("ema_bags", {"effort_unit": ema.value_of(context, "effort_unit")}),
        "recorder": ("ema_bags", {"output": ema.value_of(context, "recordings")}),
        "dashboard": ("ema_dashboard", {}),
    }
    nodes = [
        ema.node(
            context,
            name,
            package,
            further=file,
            parameters=values,
            respawns=name != "recorder",  # its folder must be new
        )
        for name, (package, values) in parameters.items()
    ]
    accept_after = int(ema.value_of(context, "accept_after"))
    return [*nodes, *ema.monitors(context, further=file, accept_after=accept_after)]
