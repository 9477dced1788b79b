# SPDX-License-Identifier: Apache-2.0
"""Nodes of the health monitor: modules, programs and command-line arguments."""

import json
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import click
from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)

from ema_ros import topics
from ema_ros.managed_node import ManagedNode

MODULES: Final = {
    "actuator": "ema_sim.actuator_node",
    "bridge": "ema_bags.inputs.bridge_node",
    "monitor": "ema_monitor.node.monitor_node",
    "recorder": "ema_bags.recorder_node",
    "player": "ema_bags.player_node",
    "dashboard": "ema_dashboard.dashboard_node",
    "robot": "ema_sim.robot_node",
}
"""Module of each node."""

NODES: Final = {
    name: (module.partition(".")[0], f"{name}_node") for name, module in MODULES.items()
}
"""Package and executable of each node, as for ``ros2 run``."""


def node_class(node: str) -> Callable[..., ManagedNode]:
    """Import and return the class of one of ``NODES``."""
    return getattr(import_module(MODULES[node]), f"{node.title()}Node")


def parameter_file(name: str) -> Path:
    """Return the path of a parameter file in ema_bringup.

    ``name`` is the name of the file without ``.yaml``.

    Raises
    ------
    ValueError
        If the package or the file is not installed.
    """
    return _installed(get_package_share_directory, "ema_bringup", "config", f"{name}.yaml")


def localhost_profile() -> Path:
    """Return the path of the profile that limits Fast DDS to this machine."""
    return _installed(get_package_share_directory, "ema_bringup", "config", "fastdds_localhost.xml")


def program(node: str) -> Path:
    """Return the path of the program of one of ``NODES``."""
    package, executable = NODES[node]
    return _installed(get_package_prefix, package, "lib", package, executable)


def _installed(folder_of: Callable[[str], str], package: str, *parts: str) -> Path:
    try:
        path = Path(folder_of(package), *parts)
    except PackageNotFoundError as error:
        raise ValueError(f"package {package} is not installed: run `make setup`") from error
    if not path.is_file():
        raise ValueError(f"{path} does not exist: run `make setup`")
    return path


def ros_arguments(
    *nodes: str,
    parameter_files: Sequence[Path] = (),
    assignments: Sequence[str] = (),
    namespace: str = topics.NAMESPACE,
    remaps: Mapping[str, str] | None = None,
) -> list[str]:
    """Return the ROS arguments for a program that runs nodes.

    For SROS2, the enclave of a single node is its full name.

    Parameters
    ----------
    nodes
        Names of the nodes; their parameter files come first.
    parameter_files
        Further parameter files.
    assignments
        Parameters as ``NAME:=VALUE``, which override the files.
    namespace
        Namespace of the nodes.
    remaps
        New names, keyed by the name to replace: topics, or ``__node`` for the node.
    """
    arguments = ["--ros-args"]
    for file in (*map(parameter_file, nodes), *parameter_files):
        arguments += ["--params-file", str(file)]
    for assignment in assignments:
        arguments += ["-p", assignment]
    place = full_namespace(namespace)
    for name, instead in ({"__ns": place} | dict(remaps or {})).items():
        arguments += ["-r", f"{name}:={instead}"]
    node_name = (remaps or {}).get("__node") or (nodes[0] if len(nodes) == 1 else "")
    if node_name:
        arguments += ["--enclave", f"{place.rstrip('/')}/{node_name}"]
    return arguments


def full_namespace(namespace: str) -> str:
    """Return a namespace as in the ROS graph, with a leading but no trailing slash."""
    return "/" + namespace.strip("/")


namespace_option: Final = click.option(
    "--namespace",
    default=topics.NAMESPACE,
    show_default=True,
    callback=lambda _, __, text: full_namespace(text),
    help="Namespace of the nodes.",
)


node_parameters_option: Final = click.option(
    "-p",
    "--param",
    "assignments",
    multiple=True,
    metavar="NAME=VALUE",
    callback=lambda _, __, texts: [_assignment(text) for text in texts],
    help="Parameter of all nodes that declare it (docs/parameters.md); overrides the files.",
)


def _assignment(text: str) -> str:
    """Convert ``NAME=VALUE`` to ``NAME:=VALUE``, the notation of ROS."""
    name, equals, value = text.partition("=")
    if not equals:
        raise click.ClickException(f"-p {text!r}: expected NAME=VALUE")
    return f"{name.removesuffix(':')}:={value}"


def assignments_of(parameters: Mapping[str, Any]) -> list[str]:
    """Return parameters as ``name:=value``, without parameters that are None."""
    # JSON is unambiguous YAML: a path that looks like a number remains a string.
    return [
        f"{name}:={json.dumps(value, ensure_ascii=False)}"
        for name, value in parameters.items()
        if value is not None
    ]
