"""``ema play``: a bag to the running system."""

import sys
from pathlib import Path

import click

from ema_cli.errors import one_clear_line
from ema_cli.processes.bringup import assignments_of, ros_arguments


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--rate", type=float, help="Seconds played in a second, 1 by default.")
@click.option(
    "--only-actuator",
    is_flag=True,
    help="Play what the actuator sent and no estimates, so that a monitor diagnoses it anew.",
)
@click.option(
    "--stay",
    is_flag=True,
    help="Stay at the end, so that the dashboard can go back, until Ctrl-C.",
)
def play(bag: Path, rate: float | None, only_actuator: bool, stay: bool) -> None:
    """Play BAG, and the time on /clock.

    The dashboard (ema up dashboard) pauses it, goes to other times and changes the rate.
    """
    parameters = {
        "bag": str(bag),
        "rate": rate,
        "actuator_only": only_actuator or None,
        "stay": stay or None,
    }
    with one_clear_line():
        arguments = ros_arguments("player", assignments=assignments_of(parameters))
    from ema_recording.player_node import main

    sys.exit(main(arguments))
