# SPDX-License-Identifier: Apache-2.0
r"""Simulated actuators, monitors with a calibration for each actuator, and the dashboard.

ros2 launch ema_bringup actuators.launch.py actuators:=left,right \
    calibration_file:=/path/{actuator_id}.yaml

One monitor serves all actuators; with ``monitors:=N``, N monitors share them.
Each actuator has its own namespace below the namespace of the monitor, and publishes on the topics
of the monitor by remapping.
"""

from launch_ros.actions import Node

from ema_bringup import launch_arguments as ema
from launch import LaunchContext, LaunchDescription

TOPICS = ("telemetry", "actuator_description", "usage", "simulated_faults", "joint_states")


def generate_launch_description() -> LaunchDescription:
    """Return the launch description with the nodes and their arguments."""
    return ema.launch(
        __file__,
        _nodes,
        ("actuator", "monitor", "dashboard"),
        history_folder=(
            "memory",
            "folder for test histories; memory: not stored, because each start simulates new units",
        ),
        actuators=("left,right", "names of the actuators, separated by commas"),
        monitors=ema.MONITORS,
    )


def _nodes(context: LaunchContext) -> list[Node]:
    namespace = ema.value_of(context, "namespace").rstrip("/")
    names = [name.strip() for name in ema.value_of(context, "actuators").split(",")]
    if len(set(names)) < len(names) or "" in names:
        raise RuntimeError(f"actuators:={','.join(names)}: expected distinct names")
    # Without their own calibrations, all actuators use the shipped calibration.
    is_calibrated = bool(ema.chosen(context, "calibration_file").get("calibration_file"))
    actuators = [
        ema.node(
            context,
            "actuator",
            "ema_sim",
            namespace=f"{namespace}/{name}",
            parameters={"actuator_id": name, "seed": number}
            | ({"serial_number": f"SIM-{name}"} if is_calibrated else {}),
            remappings=[(topic, f"{namespace}/{topic}") for topic in TOPICS],
        )
        for number, name in enumerate(names)
    ]
    # If the actuators are listed, the monitors share them equally.
    count = ema.value_of(context, "monitors")
    monitors = ema.monitors(context, count, **({"actuators": names} if count != "1" else {}))
    return [*actuators, *monitors, ema.node(context, "dashboard", "ema_dashboard")]
