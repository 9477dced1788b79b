"""Arguments that all launch files of this package have, and the nodes that they make of them."""

import sys
import tempfile
from pathlib import Path
from typing import Any

from ema_cli.processes.shards import file_for, monitor_names, shard_parameters
from ema_core.linear_algebra import one_thread
from launch import LaunchContext
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

AS_CONFIGURED = "of the parameter file"
"""Value of an argument that leaves the parameter as it is in the parameter file."""

CONFIG = PathJoinSubstitution([FindPackageShare("ema_bringup"), "config"])


def common_arguments(history_folder: str = AS_CONFIGURED) -> list[DeclareLaunchArgument]:
    """Return the arguments of each launch file."""
    return [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, default, description in (
            ("namespace", "/ema", "namespace of the nodes and of the telemetry"),
            ("use_sim_time", "false", "true: the nodes follow /clock"),
            (
                "history_folder",
                history_folder,
                "where the monitor keeps the tests of each unit; empty: in memory",
            ),
            (
                "calibration_file",
                AS_CONFIGURED,
                "calibration; {actuator_id} and {serial_number} stand for those of the actuator",
            ),
            ("log_level", "info", "debug, info, warn, error or fatal"),
            ("respawn", "false", "true: a node that ends is started again after 2 s"),
            ("autostart", "true", "false: a lifecycle manager configures and activates the nodes"),
        )
    ]


def parameter_files(*names: str) -> list[DeclareLaunchArgument]:
    """Return an argument for the parameter file of each node."""
    return [
        DeclareLaunchArgument(
            f"{name}_params",
            default_value=PathJoinSubstitution([CONFIG, f"{name}.yaml"]),
            description=f"parameter file of the {name}",
        )
        for name in names
    ]


def check_arguments(file: str, declared: list[DeclareLaunchArgument]) -> OpaqueFunction:
    """Return an action that refuses what is given and not declared; launch would ignore it.

    Included by another launch file, what is given may be for that one, and is not checked.
    """

    def check(context: LaunchContext) -> list[Any]:
        if not any(Path(argument).name == Path(file).name for argument in sys.argv):
            return []
        known = [argument.name for argument in declared]
        given = [argument.partition(":=")[0] for argument in context.argv if ":=" in argument]
        unknown = [name for name in given if name not in known]
        if unknown:
            raise RuntimeError(
                f"{Path(file).name} has no argument {', '.join(unknown)}; it has {', '.join(known)}"
            )
        return []

    return OpaqueFunction(function=check)


def value_of(context: LaunchContext, name: str) -> str:
    """Return the value of an argument."""
    return LaunchConfiguration(name).perform(context)


def flag_of(context: LaunchContext, name: str) -> bool:
    """Return the value of an argument that is true or false."""
    value = value_of(context, name)
    if value.lower() not in ("true", "false"):
        raise RuntimeError(f"{name}:={value}: expected true or false")
    return value.lower() == "true"


def node(
    context: LaunchContext,
    name: str,
    package: str,
    *,
    namespace: str = "",
    node_name: str = "",
    file: str = "",
    parameters: dict[str, Any] | None = None,
    ends_all: bool = False,
    respawns: bool = True,
    **options: Any,
) -> Node:
    """Return a node of this package's by the common arguments.

    Parameters
    ----------
    namespace
        Namespace instead of that of the argument.
    node_name
        Name of the node instead of that of its program.
    file
        Parameter file instead of that of the argument.
    parameters
        Parameters that override those of its parameter file.
    ends_all
        Whether everything ends with it; it is never started again then.
    respawns
        Whether it is started again if the argument says so.
    """
    own = {"autostart": flag_of(context, "autostart"), **(parameters or {})}
    if flag_of(context, "use_sim_time"):
        own["use_sim_time"] = True
    # Launch would read a text as YAML: an empty one, or a name such as 4711, would be no text.
    texts = {key: value for key, value in own.items() if isinstance(value, str)}
    own |= {key: ParameterValue(value, value_type=str) for key, value in texts.items()}
    if ends_all:
        options["on_exit"] = Shutdown(reason=f"the {name} has ended")
    place = namespace or value_of(context, "namespace")
    # Of the node's full name; it matters where SROS2 is enabled.
    enclave = "/".join(("", *filter(None, (place.strip("/"), node_name or name))))
    return Node(
        package=package,
        executable=f"{name}_node",
        name=node_name or name,
        namespace=place,
        parameters=[file or value_of(context, f"{name}_params"), own],
        ros_arguments=["--log-level", value_of(context, "log_level"), "--enclave", enclave],
        respawn=respawns and not ends_all and flag_of(context, "respawn"),
        respawn_delay=2.0,
        additional_env=one_thread(),
        output="screen",
        **options,
    )


def monitors_argument() -> DeclareLaunchArgument:
    """Return the argument for how many monitors share the actuators."""
    return DeclareLaunchArgument(
        "monitors",
        default_value="1",
        description="processes that share the actuators, by their names: monitor_0 and on",
    )


def monitors(context: LaunchContext, **parameters: Any) -> list[Node]:
    """Return the monitors; what is not given is as in their parameter file."""
    text = value_of(context, "monitors")
    try:
        names = monitor_names(int(text))
    except ValueError as error:
        raise RuntimeError(f"monitors:={text}: expected a whole number from 1 on") from error
    if len(names) == 1:
        return [monitor(context, **parameters)]
    folder, file = Path(tempfile.mkdtemp(prefix="ema_")), Path(value_of(context, "monitor_params"))
    return [
        monitor(
            context,
            node_name=name,
            file=str(file_for(name, file, folder)),
            **parameters,
            **shard_parameters(index, len(names)),
        )
        for index, name in enumerate(names)
    ]


def monitor(
    context: LaunchContext, *, node_name: str = "", file: str = "", **parameters: Any
) -> Node:
    """Return a monitor; what is not given is as in its parameter file."""
    names = ("calibration_file", "history_folder")
    given = {name: value_of(context, name) for name in names}
    chosen = {name: value for name, value in given.items() if value != AS_CONFIGURED}
    return node(
        context,
        "monitor",
        "ema_monitor",
        node_name=node_name,
        file=file,
        parameters={**chosen, **parameters},
    )
