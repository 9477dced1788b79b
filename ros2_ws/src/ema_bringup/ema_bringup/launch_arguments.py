# SPDX-License-Identifier: Apache-2.0
"""Arguments common to the launch files of this package, and nodes that use them."""

import atexit
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from ema_core.array_environment import array_environment
from ema_ros.monitor_shards import file_for, monitor_names, shard_parameters
from launch import LaunchContext, LaunchDescription

_COMMON = {
    "namespace": ("/ema", "namespace of the nodes and of the telemetry"),
    "use_sim_time": ("false", "true: the nodes follow /clock"),
    "log_level": ("info", "debug, info, warn, error or fatal"),
    "respawn": ("false", "true: a node that exits is restarted after 2 s"),
    "autostart": ("true", "false: a lifecycle manager configures and activates the nodes"),
}
_OF_MONITOR = {
    "history_folder": (
        "",
        "folder in which the monitor stores the tests of each unit; memory: not stored; empty: as "
        "in monitor_params",
    ),
    "calibration_file": (
        "",
        "calibration file; {actuator_id} and {serial_number} are replaced for each actuator; "
        "empty: as in monitor_params",
    ),
}
MONITORS = (
    "1",
    "number of monitor processes that share the actuators; named monitor_0, monitor_1, ...",
)
"""Default and description of the argument for the number of monitors."""


def launch(
    file: str,
    make_nodes: Callable[[LaunchContext], list[Any]],
    nodes: Sequence[str],
    **arguments: tuple[str | None, str],
) -> LaunchDescription:
    """Return the description of a launch file.

    Undeclared arguments, which launch would ignore, are refused, unless another launch file
    includes this one: then they may be arguments of the other file.

    Parameters
    ----------
    file
        Path of the launch file.
    make_nodes
        Function that returns the nodes for a launch context.
    nodes
        Names of the nodes, each with an argument for its parameter file. If ``monitor`` is one of
        them, there are also arguments for its files.
    arguments
        Default and description of further arguments; required ones have the default None.
    """
    common = _COMMON | (_OF_MONITOR if "monitor" in nodes else {})
    files = {
        f"{name}_params": (shipped_file(name), f"parameter file of the {name}") for name in nodes
    }
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in {**common, **arguments, **files}.items()
    ]

    def check(context: LaunchContext) -> list[Any]:
        if not any(Path(argument).name == Path(file).name for argument in sys.argv):
            return []
        names = [argument.name for argument in declared]
        specified = [argument.partition(":=")[0] for argument in context.argv if ":=" in argument]
        unknown = [name for name in specified if name not in names]
        if unknown:
            raise RuntimeError(
                f"{Path(file).name} has no argument {', '.join(unknown)}; arguments: "
                f"{', '.join(names)}"
            )
        return []

    start = [OpaqueFunction(function=check), OpaqueFunction(function=make_nodes)]
    return LaunchDescription([*declared, *start])


def shipped_file(name: str) -> str:
    """Return the path of a parameter file of this package, by its name without suffix."""
    return str(Path(get_package_share_directory("ema_bringup"), "config", f"{name}.yaml"))


def value_of(context: LaunchContext, name: str) -> str:
    """Return the value of a launch argument."""
    return LaunchConfiguration(name).perform(context)


def chosen(context: LaunchContext, *names: str) -> dict[str, str]:
    """Return the values of the arguments that are not empty: they override the parameter file."""
    values = {name: value_of(context, name) for name in names}
    return {name: value for name, value in values.items() if value}


def flag_of(context: LaunchContext, name: str) -> bool:
    """Return the value of a launch argument; RuntimeError if it is neither true nor false."""
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
    further: str = "",
    parameters: dict[str, Any] | None = None,
    ends_all: bool = False,
    respawns: bool = True,
    **options: Any,
) -> Node:
    """Return a launch node configured by the common arguments.

    Parameters
    ----------
    context
        Context of the launch, with the values of the arguments.
    name, package
        Name of the node and of its package.
    namespace, node_name, file
        Namespace, name and parameter file, if they differ from the common arguments.
    further
        Further parameter file, which overrides the first; empty for none.
    parameters
        Parameters that override the parameter file.
    ends_all
        Whether the end of the node ends the launch; such a node is not restarted.
    respawns
        Whether the node is restarted when it exits, if the argument ``respawn`` is true.
    options
        Further arguments of the ``Node``.
    """
    file = file or value_of(context, f"{name}_params")
    _require_file(name, file)
    if further:
        _require_file(Path(further).stem, further)
    overrides = {"autostart": flag_of(context, "autostart"), **(parameters or {})}
    if flag_of(context, "use_sim_time"):
        overrides["use_sim_time"] = True
    # Launch would parse strings as YAML: "" or a name such as 4711 would change its type.
    texts = {key: value for key, value in overrides.items() if isinstance(value, str)}
    overrides |= {key: ParameterValue(value, value_type=str) for key, value in texts.items()}
    if ends_all:
        options["on_exit"] = Shutdown(reason=f"the {name} has ended")
    node_namespace = namespace or value_of(context, "namespace")
    # The enclave of the node's full name, for SROS2.
    enclave = "/".join(("", *filter(None, (node_namespace.strip("/"), node_name or name))))
    return Node(
        package=package,
        executable=f"{name}_node",
        name=node_name or name,
        namespace=node_namespace,
        parameters=[*filter(None, (file, further)), overrides],
        ros_arguments=["--log-level", value_of(context, "log_level"), "--enclave", enclave],
        respawn=respawns and not ends_all and flag_of(context, "respawn"),
        respawn_delay=2.0,
        additional_env=array_environment(),
        output="screen",
        **options,
    )


def monitors(
    context: LaunchContext, count: str = "1", further: str = "", **parameters: Any
) -> list[Node]:
    """Return monitors that share the actuators; parameters override their parameter files.

    ``further`` is as in ``node``. RuntimeError if ``count`` is not an integer of at least 1.
    """
    try:
        names = monitor_names(int(count))
    except ValueError as error:
        raise RuntimeError(f"monitors:={count}: expected an integer of at least 1") from error
    overrides = chosen(context, "calibration_file", "history_folder") | parameters
    if len(names) == 1:
        return [node(context, "monitor", "ema_monitor", further=further, parameters=overrides)]
    file = Path(value_of(context, "monitor_params"))
    _require_file("monitor", str(file))
    folder = Path(tempfile.mkdtemp(prefix="ema_"))
    # Keep the files until exit: a restarted monitor reads its file again.
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return [
        node(
            context,
            "monitor",
            "ema_monitor",
            node_name=name,
            file=str(file_for(name, file, folder)),
            further=further,
            parameters=overrides | shard_parameters(index, len(names)),
        )
        for index, name in enumerate(names)
    ]


def _require_file(name: str, file: str) -> None:
    # Launch would start the node with its defaults.
    if not Path(file).is_file():
        raise RuntimeError(f"{name}_params:={file}: no such file")
