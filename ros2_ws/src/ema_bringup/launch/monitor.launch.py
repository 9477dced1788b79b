"""The monitor alone, for an actuator that publishes its own telemetry.

ros2 launch ema_bringup monitor.launch.py calibration_file:=/path/calibration.yaml
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return the node, with its arguments."""
    config = PathJoinSubstitution([FindPackageShare("ema_bringup"), "config"])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "namespace",
                default_value="/ema",
                description="namespace of the monitor and of the telemetry",
            ),
            DeclareLaunchArgument(
                "calibration_file",
                default_value="",
                description="calibration of the actuator; empty: as in the parameter file",
            ),
            DeclareLaunchArgument(
                "actuator_file",
                default_value="",
                description="description of an actuator that publishes none; empty: as in the "
                "parameter file",
            ),
            DeclareLaunchArgument(
                "params_file",
                default_value=PathJoinSubstitution([config, "monitor.yaml"]),
                description="parameter file of the monitor",
            ),
            OpaqueFunction(function=_monitor),
        ]
    )


def _monitor(context: LaunchContext) -> list[Node]:
    """Return the monitor; an empty argument does not override the parameter file."""
    files = {
        name: value
        for name in ("calibration_file", "actuator_file")
        if (value := LaunchConfiguration(name).perform(context))
    }
    return [
        Node(
            package="ema_monitor",
            executable="monitor_node",
            name="monitor",
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("params_file"), *([files] if files else [])],
            output="screen",
        )
    ]
