# SPDX-License-Identifier: Apache-2.0
"""``ema up``: run the nodes of the health monitor as processes."""

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from ema_cli.options import UNUSABLE, network_option
from ema_cli.processes.bringup import (
    NODES,
    namespace_option,
    node_parameters_option,
    parameter_file,
    program,
    ros_arguments,
)
from ema_cli.processes.listener import refuse_running
from ema_cli.processes.node_commands import NodeOptions, actuator_commands, monitor_commands
from ema_cli.processes.reach import set_reach
from ema_cli.processes.stop_request import ENDING, deferred_signals
from ema_cli.processes.supervisor import POLL_S, Supervisor


@click.command()
@click.argument(
    "nodes", nargs=-1, type=click.Choice(list(NODES)), metavar=f"[{'|'.join(NODES)}]..."
)
@click.option(
    "--params",
    "parameter_files",
    multiple=True,
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Further ROS parameter file for all nodes; overrides the shipped files.",
)
@node_parameters_option
@namespace_option
@click.option(
    "--actuators",
    metavar="NAME,...",
    help="Names of several simulated actuators, each in its own namespace.",
)
@click.option(
    "--monitors",
    type=click.IntRange(1, 256),
    default=1,
    help="Number of monitor processes that share the actuators.",
)
@network_option
def up(
    nodes: tuple[str, ...],
    parameter_files: tuple[Path, ...],
    assignments: list[str],
    namespace: str,
    actuators: str | None,
    monitors: int,
    network: bool,
) -> None:
    """Run nodes until Ctrl-C; by default simulated actuator, monitor and dashboard.

    The dashboard prints its address. If one node exits, the others keep running. Exit code 1: a
    node failed, or a node of the same name is already running. A simulated actuator is a new unit
    at each start; the monitor then keeps its history in memory, unless history_folder is set.
    """
    with (
        deferred_signals(*ENDING) as stop,
        TemporaryDirectory(prefix="ema_up_") as folder,
        Supervisor(lambda line: click.echo(f"ema up: {line}", err=True), "recorder") as processes,
    ):
        set_reach(network)
        names = dict.fromkeys(nodes or ("actuator", "monitor", "dashboard"))
        actuator_ids = (
            [name.strip() for name in actuators.split(",")] if actuators is not None else []
        )
        if "actuator" in names:
            parameter_files = (parameter_file("simulated"), *parameter_files)
        elif actuator_ids:
            raise click.UsageError(f"--actuators {actuators}: expected the node `actuator` as well")
        node_options = NodeOptions(parameter_files, assignments, namespace)
        commands = {}
        for node in names:
            if node == "monitor":
                commands |= monitor_commands(monitors, node_options, Path(folder), actuator_ids)
            elif node == "actuator" and actuator_ids:
                commands |= actuator_commands(actuator_ids, node_options)
            else:
                commands[node] = [str(program(node)), *ros_arguments(node, **vars(node_options))]
        # The key `actuator left` is the node `actuator` in the namespace `left`.
        parts = (node.partition(" ") for node in commands)
        full = ("/".join(filter(None, (namespace, actuator, name))) for name, _, actuator in parts)
        refuse_running(full, "watch", stop)
        for node, command in commands.items():
            if not stop:
                processes.start(node, command)
        while processes.running and not stop:
            time.sleep(POLL_S)
            processes.check()
    if processes.failed:
        sys.exit(UNUSABLE)
