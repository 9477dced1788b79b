"""The option of commands that make nodes: how far these are heard."""

from collections.abc import Callable
from typing import Any

import click


def network_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the option ``--network``; its function has an argument of that name."""
    return click.option(
        "--network",
        is_flag=True,
        help="Let nodes find, and be found by, nodes on other machines, as ROS's own variables "
        "allow; without it nodes stay on this machine.",
    )(command)
