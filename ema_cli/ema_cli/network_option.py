"""The option of commands that make nodes: how far these are heard."""

from collections.abc import Callable
from typing import Any

import click


def network_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the option ``--network``; its function has an argument of that name."""
    return click.option(
        "--network",
        is_flag=True,
        help="Let nodes find those of other machines, and be found by them, as ROS's own variables "
        "say; without it they keep to this machine.",
    )(command)
