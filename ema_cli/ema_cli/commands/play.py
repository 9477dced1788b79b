# SPDX-License-Identifier: Apache-2.0
"""``ema play``: play a bag to the running system."""

from pathlib import Path

import click

from ema_cli.options import network_option
from ema_cli.processes.bringup import node_parameters_option
from ema_cli.processes.reach import run_node


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--rate", type=float, help="Playback rate, 1 by default.")
@click.option("--loop", is_flag=True, help="Restart at the end, until Ctrl-C.")
@click.option(
    "--topic",
    "topics",
    multiple=True,
    help="Topic to play (repeatable), full name or relative to /ema; by default all topics.",
)
@click.option(
    "--only-actuator",
    is_flag=True,
    help="Play only the actuator's messages, for a new diagnosis by a monitor.",
)
@click.option(
    "--stay", is_flag=True, help="Stay at the end until Ctrl-C, so that the dashboard can seek."
)
@node_parameters_option
@network_option
def play(
    bag: Path,
    rate: float | None,
    topics: tuple[str, ...],
    only_actuator: bool,
    assignments: list[str],
    network: bool,
    **flags: bool,
) -> None:
    """Play BAG, and publish its time on /clock.

    The dashboard (ema up dashboard) can pause, seek and change the rate; services of the player can
    also play message by message. The parameters start_offset and playback_duration select a part of
    the bag; with start_paused, the player waits to be resumed.
    """
    parameters = {
        "bag": str(bag),
        "rate": rate,
        "topics": list(topics) or None,
        "actuator_only": only_actuator or None,
        **{name: value or None for name, value in flags.items()},
    }
    run_node("player", parameters, assignments, network=network)
