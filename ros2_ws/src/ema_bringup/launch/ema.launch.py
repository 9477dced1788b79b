# SPDX-License-Identifier: Apache-2.0
"""Simulated actuator, monitor, dashboard and, if a bag is named, recorder.

ros2 launch ema_bringup ema.launch.py bag:=worn_flap
"""

from launch_ros.actions import Node

from ema_bringup import launch_arguments as ema
from launch import LaunchContext, LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """Return the launch description with the nodes and their arguments."""
    return ema.launch(
        __file__,
        _nodes,
        ("actuator", "monitor", "dashboard", "recorder"),
        history_folder=(
            "memory",
            "folder for test histories; memory: not stored, because each start simulates a new "
            "unit",
        ),
        bag=("", "bag to record; empty: no recorder; if the recorder fails, all nodes end"),
    )


def _nodes(context: LaunchContext) -> list[Node]:
    nodes = [
        ema.node(context, "actuator", "ema_sim"),
        *ema.monitors(context),
        ema.node(context, "dashboard", "ema_dashboard"),
    ]
    bag = {"output": ema.value_of(context, "bag")}
    if bag["output"]:
        recorder = ema.node(context, "recorder", "ema_bags", parameters=bag, ends_all=True)
        nodes.append(recorder)
    return nodes
