# SPDX-License-Identifier: Apache-2.0
"""``ema record``: record the running system to a bag."""

from pathlib import Path

import click

from ema_cli.options import network_option
from ema_cli.output import BAG_TO_WRITE, output_option
from ema_cli.processes.bringup import node_parameters_option
from ema_cli.processes.reach import run_node


@click.command()
@output_option(f"{BAG_TO_WRITE}; by default a folder named by date and time", required=False)
@click.option(
    "--topic",
    "topics",
    multiple=True,
    help=(
        "Topic to record (repeatable), full name or relative to /ema; by default all in /ema, "
        "/diagnostics and /clock."
    ),
)
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

    A bag with several files is a folder. Each file starts with the latched messages (descriptions,
    service lives, health), so that it can be read separately. The parameters max_bag_size and
    max_bag_duration limit the size of a file. With snapshot_duration, messages stay in memory for
    that time; they are written when a level changes, or by the service ~/snapshot.
    """
    parameters = {
        "output": None if output is None else str(output),
        "topics": list(topics) or None,
        "overwrite": overwrite or None,
    }
    run_node("recorder", parameters, assignments, network=network)
