"""Telemetry of an actuator from the topics of another make, beside a monitor.

ros2 launch ema_bringup bridge.launch.py mapping_file:=/path/mapping.yaml
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
                description="namespace of the bridge, and of the telemetry it publishes",
            ),
            DeclareLaunchArgument(
                "mapping_file",
                default_value="",
                description="mapping of topics to telemetry; empty: as in the parameter file",
            ),
            DeclareLaunchArgument(
                "actuator_file",
                default_value="",
                description="description of the actuator; empty: as in the parameter file",
            ),
            DeclareLaunchArgument(
                "params_file",
                default_value=PathJoinSubstitution([config, "bridge.yaml"]),
                description="parameter file of the bridge",
            ),
            OpaqueFunction(function=_bridge),
        ]
    )


def _bridge(context: LaunchContext) -> list[Node]:
    """Return the bridge; an empty argument does not override the parameter file."""
    files = {
        name: value
        for name in ("mapping_file", "actuator_file")
        if (value := LaunchConfiguration(name).perform(context))
    }
    return [
        Node(
            package="ema_inputs",
            executable="bridge_node",
            name="bridge",
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("params_file"), *([files] if files else [])],
            output="screen",
        )
    ]
