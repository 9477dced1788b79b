"""``ema record``: the running system to a bag."""

import sys
from pathlib import Path

import click

from ema_cli.errors import one_clear_line
from ema_cli.network_option import network_option
from ema_cli.processes.bringup import (
    assignments_of,
    node_parameters_option,
    ros_arguments,
)
from ema_cli.processes.reach import set_reach


@click.command()
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Bag to write: one file if it ends in .mcap, else a folder; by default a folder named by "
    "date and time.",
)
@click.option(
    "--topic",
    "topics",
    multiple=True,
    help="Topic to record, full name or relative to /ema; by default all of /ema, /diagnostics and "
    "/clock.",
)
@click.option("--replace", "overwrite", is_flag=True, help="Replace an existing bag.")
@node_parameters_option
@network_option
def record(
    output: Path | None,
    topics: tuple[str, ...],
    overwrite: bool,
    assignments: list[str],
    network: bool,
) -> None:
    """Record telemetry, estimates and health until Ctrl-C.

    A bag in several files is a folder. Each file begins with what is latched (descriptions, service
    lives, health), so that it can be read alone. The parameters max_bag_size and max_bag_duration
    begin the next file; with snapshot_duration, so much is kept in memory, and written when a level
    changes, or by service ~/snapshot.
    """
    parameters = {
        "output": None if output is None else str(output),
        "topics": list(topics) or None,
        "overwrite": overwrite or None,
    }
    with one_clear_line():
        set_reach(network)
        arguments = ros_arguments(
            "recorder", assignments=[*assignments_of(parameters), *assignments]
        )
    from ema_bags.recorder_node import main

    sys.exit(main(arguments))
