"""The ``ema`` command."""

from importlib import import_module
from typing import Final

import click

_COMMANDS: Final = (
    "simulate",
    "lives",
    "calibrate",
    "estimate",
    "compare",
    "prognose",
    "thesis",
    "plot",
    "info",
    "up",
    "record",
    "play",
    "recover",
    "demo",
)


class _CommandsOnDemand(click.Group):
    """Imports a command when it is called, so that none waits for what another one needs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        return getattr(import_module(f"ema_cli.{cmd_name}"), cmd_name)


@click.group(
    cls=_CommandsOnDemand,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
def main() -> None:
    """Simulate electromechanical actuators, and find the faults in their telemetry.

    Exit codes: 0 done, 1 the input cannot be used, 2 wrong usage, 3 some windows have no valid
    estimate.
    """
