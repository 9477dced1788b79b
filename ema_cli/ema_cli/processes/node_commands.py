# SPDX-License-Identifier: Apache-2.0
"""Command lines that start several actuators, and the monitors that share them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from ema_cli.processes.bringup import assignments_of, parameter_file, program, ros_arguments
from ema_ros.monitor_shards import file_for, monitor_names, shard_parameters
from ema_ros.topics import ACTUATOR_TOPICS, NAMESPACE


@dataclass(frozen=True)
class NodeOptions:
    """Arguments common to all nodes: parameter files, assignments and namespace."""

    parameter_files: Sequence[Path] = ()
    assignments: Sequence[str] = ()
    namespace: str = NAMESPACE


def monitor_commands(
    monitors: int, options: NodeOptions, folder: Path, actuators: Sequence[str] = ()
) -> dict[str, list[str]]:
    """Return the commands of monitors that share the actuators, keyed by node name.

    ``folder`` receives copies of parameter files that are specific to a monitor.
    """
    commands = {}
    listed = {"actuators": list(actuators)} if actuators and monitors > 1 else {}
    for index, name in enumerate(monitor_names(monitors)):
        arguments = ros_arguments(
            parameter_files=[
                file_for(name, file, folder)
                for file in (parameter_file("monitor"), *options.parameter_files)
            ],
            assignments=[
                *assignments_of(listed),
                *options.assignments,
                *assignments_of(shard_parameters(index, monitors)),
            ],
            namespace=options.namespace,
            remaps={"__node": name},
        )
        commands[name] = [str(program("monitor")), *arguments]
    return commands


def actuator_commands(names: Sequence[str], options: NodeOptions) -> dict[str, list[str]]:
    """Return the commands of simulated actuators, keyed by "actuator NAME".

    Each node has its own namespace, but publishes in the namespace of ``options``.
    """
    if len(set(names)) < len(names):
        raise click.UsageError(f"--actuators {','.join(names)}: expected distinct names")
    place = options.namespace.rstrip("/")
    commands = {}
    for number, name in enumerate(names):
        try:
            validate_namespace(f"{place}/{name}")
        except InvalidNamespaceException as error:
            raise ValueError(
                f"--actuators {name!r}: expected letters, digits and _, because it is used as a "
                "namespace"
            ) from error
        identity = {"actuator_id": name, "seed": number}
        arguments = ros_arguments(
            "actuator",
            parameter_files=options.parameter_files,
            assignments=[*assignments_of(identity), *options.assignments],
            namespace=f"{place}/{name}",
            remaps={topic: f"{place}/{topic}" for topic in ACTUATOR_TOPICS},
        )
        commands[f"actuator {name}"] = [str(program("actuator")), *arguments]
    return commands
