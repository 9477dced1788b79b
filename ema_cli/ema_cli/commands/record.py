"""``ema record``: the running system to a bag."""

import sys
from pathlib import Path

import click

from ema_cli.errors import one_clear_line
from ema_cli.network_option import network_option
from ema_cli.processes.bringup import assignments_of, ros_arguments
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
@click.option("--max-bag-size", type=int, metavar="BYTES", help="Begin the next file at this size.")
@click.option(
    "--max-bag-duration", type=float, metavar="SECONDS", help="Begin the next file after this time."
)
@click.option(
    "--snapshot-duration",
    type=float,
    metavar="SECONDS",
    help="Keep this much in memory, and write it when a level changes, or by service ~/snapshot.",
)
@click.option(
    "--max-cache-size",
    type=int,
    metavar="BYTES",
    help="Memory for a snapshot, 100 MiB by default.",
)
@network_option
def record(
    output: Path | None,
    topics: tuple[str, ...],
    overwrite: bool,
    network: bool,
    **limits: float | None,
) -> None:
    """Record telemetry, estimates and health until Ctrl-C.

    A bag in several files is a folder. Each file begins with what is latched (descriptions, service
    lives, health), so that it can be read alone.
    """
    parameters = {
        "output": None if output is None else str(output),
        "topics": list(topics) or None,
        "overwrite": overwrite or None,
        **limits,
    }
    with one_clear_line():
        set_reach(network)
        arguments = ros_arguments("recorder", assignments=assignments_of(parameters))
    from ema_bags.recorder_node import main

    sys.exit(main(arguments))
