"""``ema demo``: show and record an actuator that wears out."""

import sys
from pathlib import Path

import click

from ema_cli.options import network_option
from ema_cli.processes.stop_request import ENDING, deferred_signals


@click.command()
@click.option(
    "--duration",
    "duration_s",
    default=60.0,
    type=click.FloatRange(5.0, 86400.0),
    help="Duration from the first test cycle [s].",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for bag, picture and logs; by default bags/demo_DATE_TIME.",
)
@network_option
def demo(duration_s: float, output: Path | None, network: bool) -> None:
    """Watch a simulated actuator wear out, live and on the dashboard, then in a picture.

    When a test detects a failure, a simulated technician repairs the actuator, and wear starts
    again. The folder stores the test history, from which a restarted monitor continues. The demo
    uses ROS_DOMAIN_ID if it is set, and a free domain otherwise.
    """
    with deferred_signals(*ENDING) as stop:
        # Imported here, since signals must be recorded before slow imports.
        from ema_cli.processes.demo_run import run_demo

        run_demo(duration_s, output, stop, network=network)
    if stop.number is not None:
        sys.exit(128 + stop.number)
