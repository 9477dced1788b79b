# SPDX-License-Identifier: Apache-2.0
"""``ema watch``: show the health of all actuators in the terminal."""

import os
import time
from typing import Final

import click
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from ema_cli.options import network_option
from ema_cli.processes.health_listener import HealthListener
from ema_cli.processes.reach import set_reach
from ema_cli.processes.stop_request import ENDING, deferred_signals
from ema_cli.show.health_table import HealthTable
from ema_interfaces.msg import Health
from ema_ros.topics import HEALTH, NAMESPACE

_REFRESH_S: Final = 0.25
_DISCOVERY_S: Final = 3.0


@click.command()
@click.option(
    "--namespace",
    "namespaces",
    multiple=True,
    default=(NAMESPACE,),
    help="Namespace of a monitor (repeatable).",
)
@click.option(
    "--until-played",
    is_flag=True,
    help="Exit when a player has ended and the monitor has identified the played data.",
)
@network_option
def watch(namespaces: tuple[str, ...], until_played: bool, network: bool) -> None:
    """Show the health of all actuators, worst first, until Ctrl-C.

    On a terminal, the command shows a live table, otherwise a line for each change. An actuator is
    STALE if its monitor is silent. ROS_DOMAIN_ID selects the domain.
    """
    set_reach(network)
    places = list(dict.fromkeys(_normalised(namespace) for namespace in namespaces))
    with (
        deferred_signals(*ENDING) as stop,
        HealthTable(f"on {', '.join(places)} in {_domain()}") as table,
        HealthListener(places, "watch") as listener,
    ):
        began_s = time.monotonic()
        player_seen = False
        while not stop and not (until_played and listener.completion.is_complete):
            if until_played:
                is_running = any(listener.sees("player", place) for place in places)
                if player_seen and not is_running:
                    listener.completion.end()
                player_seen |= is_running
            rows = listener.rows()
            is_waiting = time.monotonic() - began_s < _DISCOVERY_S
            table.show(rows, "" if rows or is_waiting else _no_health(places, listener))
            listener.changed.wait(_REFRESH_S)
            listener.changed.clear()
        table.show(listener.rows(), "")


def _normalised(namespace: str) -> str:
    """Return a namespace as used in the ROS graph."""
    full = "/" + namespace.strip("/")
    try:
        validate_namespace(full)
    except InvalidNamespaceException as error:
        raise click.UsageError(
            f"--namespace {namespace!r}: expected a name of letters, digits and _, such as /ema"
        ) from error
    return full


def _domain() -> str:
    return f"domain {os.environ.get('ROS_DOMAIN_ID') or 0}"


def _no_health(places: list[str], listener: HealthListener) -> str:
    """Return a message that no health is published, with the next step."""
    words = f"no health is published on {', '.join(places)} in {_domain()}"
    elsewhere = [
        topic.removesuffix(f"/{HEALTH}") or "/"
        for topic in listener.topics_of(Health)
        if topic.endswith(f"/{HEALTH}")
    ]
    rest = [place for place in elsewhere if place not in places]
    if rest:
        return f"{words}, but on {', '.join(rest)}: select it with --namespace"
    if listener.has_monitor():
        return f"{words}: the monitor is waiting for its first valid test"
    return (
        f"{words}: check that a monitor is running; ROS_DOMAIN_ID and --namespace select another "
        "one, --network includes other machines"
    )
