"""Simulated actuator, monitor, dashboard and, if a bag is named, recorder.

ros2 launch ema_bringup ema.launch.py bag:=worn_flap
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return the nodes, with their arguments."""
    config = PathJoinSubstitution([FindPackageShare("ema_bringup"), "config"])
    namespace = LaunchConfiguration("namespace")
    bag = LaunchConfiguration("bag")
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "namespace", default_value="/ema", description="namespace of the nodes"
            ),
            DeclareLaunchArgument(
                "actuator_params",
                default_value=PathJoinSubstitution([config, "actuator.yaml"]),
                description="parameter file of the actuator; with demo.yaml it wears out",
            ),
            DeclareLaunchArgument(
                "monitor_params",
                default_value=PathJoinSubstitution([config, "monitor.yaml"]),
                description="parameter file of the monitor",
            ),
            DeclareLaunchArgument(
                "history_folder",
                default_value="",
                description="where the monitor keeps the tests of each unit; empty: in memory, "
                "as a simulated actuator is a new unit at each start",
            ),
            DeclareLaunchArgument(
                "recorder_params",
                default_value=PathJoinSubstitution([config, "recorder.yaml"]),
                description="parameter file of the recorder",
            ),
            DeclareLaunchArgument(
                "dashboard_params",
                default_value=PathJoinSubstitution([config, "dashboard.yaml"]),
                description="parameter file of the dashboard, which prints its address",
            ),
            DeclareLaunchArgument(
                "bag", default_value="", description="bag to record; empty: no recorder"
            ),
            Node(
                package="ema_sim",
                executable="actuator_node",
                name="actuator",
                namespace=namespace,
                parameters=[LaunchConfiguration("actuator_params")],
                output="screen",
            ),
            Node(
                package="ema_monitor",
                executable="monitor_node",
                name="monitor",
                namespace=namespace,
                parameters=[
                    LaunchConfiguration("monitor_params"),
                    {
                        "history_folder": ParameterValue(
                            LaunchConfiguration("history_folder"), value_type=str
                        )
                    },
                ],
                output="screen",
            ),
            Node(
                package="ema_dashboard",
                executable="dashboard_node",
                name="dashboard",
                namespace=namespace,
                parameters=[LaunchConfiguration("dashboard_params")],
                output="screen",
            ),
            Node(
                package="ema_recording",
                executable="recorder_node",
                name="recorder",
                namespace=namespace,
                parameters=[
                    LaunchConfiguration("recorder_params"),
                    {"output": ParameterValue(bag, value_type=str)},
                ],
                output="screen",
                condition=IfCondition(NotEqualsSubstitution(bag, "")),
            ),
        ]
    )
