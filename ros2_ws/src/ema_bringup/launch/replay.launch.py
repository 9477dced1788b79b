"""Diagnosis of a recording: the topics of the actuator are played to a monitor, and shown.

ros2 launch ema_bringup replay.launch.py bag:=worn_flap rate:=4.0
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return the nodes, with their arguments."""
    config = PathJoinSubstitution([FindPackageShare("ema_bringup"), "config"])
    bag = ParameterValue(LaunchConfiguration("bag"), value_type=str)
    rate = ParameterValue(LaunchConfiguration("rate"), value_type=float)
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="bag to play: a file or a folder"),
            DeclareLaunchArgument(
                "rate", default_value="1.0", description="playback rate"
            ),
            DeclareLaunchArgument(
                "namespace",
                default_value="/ema",
                description="namespace of the nodes, which is that of the telemetry in the bag",
            ),
            DeclareLaunchArgument(
                "player_params",
                default_value=PathJoinSubstitution([config, "player.yaml"]),
                description="parameter file of the player",
            ),
            DeclareLaunchArgument(
                "monitor_params",
                default_value=PathJoinSubstitution([config, "monitor.yaml"]),
                description="parameter file of the monitor, with its calibration_file",
            ),
            Node(
                package="ema_monitor",
                executable="monitor_node",
                name="monitor",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    LaunchConfiguration("monitor_params"),
                    {"use_sim_time": True},
                ],
                output="screen",
            ),
            DeclareLaunchArgument(
                "dashboard_params",
                default_value=PathJoinSubstitution([config, "dashboard.yaml"]),
                description="parameter file of the dashboard, which prints its address",
            ),
            Node(
                package="ema_dashboard",
                executable="dashboard_node",
                name="dashboard",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("dashboard_params")],
                output="screen",
            ),
            Node(
                package="ema_recording",
                executable="player_node",
                name="player",
                namespace=LaunchConfiguration("namespace"),
                parameters=[
                    LaunchConfiguration("player_params"),
                    {"bag": bag, "rate": rate, "actuator_only": True},
                ],
                output="screen",
            ),
        ]
    )
