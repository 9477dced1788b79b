"""``ema play``: play a bag to the running system."""

from pathlib import Path

import click

from ema_cli.options import network_option
from ema_cli.processes.bringup import node_parameters_option
from ema_cli.processes.reach import run_node


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option("--rate", type=float, help="Seconds played in a second, 1 by default.")
@click.option("--loop", is_flag=True, help="Begin again at the end, until Ctrl-C.")
@click.option(
    "--topic",
    "topics",
    multiple=True,
    help="Topic to play, full name or relative to /ema; by default all.",
)
@click.option(
    "--only-actuator",
    is_flag=True,
    help="Play the actuator's messages without estimates, for a new diagnosis by a monitor.",
)
@click.option(
    "--stay", is_flag=True, help="Stay at the end, so that the dashboard can go back, until Ctrl-C."
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
    """Play BAG, and the time on /clock.

    The dashboard (ema up dashboard) pauses it, goes to other times and changes the rate; services
    of the player do so too, and play message by message. The parameters start_offset and
    playback_duration choose a part of the bag; start_paused waits to be resumed.
    """
    parameters = {
        "bag": str(bag),
        "rate": rate,
        "topics": list(topics) or None,
        "actuator_only": only_actuator or None,
        **{name: value or None for name, value in flags.items()},
    }
    run_node("player", parameters, assignments, network=network)
