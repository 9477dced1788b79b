# SPDX-License-Identifier: Apache-2.0
"""``ema demo``: show and record an actuator that wears out."""

import sys
from pathlib import Path
from typing import Final

import click

from ema_cli.options import UNUSABLE, network_option
from ema_cli.processes.stop_request import ENDING, deferred_signals

_ACTUATOR_S: Final = 60.0
_ROBOT_S: Final = 420.0


@click.command()
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(5.0, 86400.0),
    help="Duration [s] from the first test cycle or joint; by default 60, with --robot 420.",
)
@click.option("--robot", is_flag=True, help="Simulate an arm of six joints, and attach to it.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for bag, picture and logs; by default bags/demo_DATE_TIME.",
)
@network_option
def demo(duration_s: float | None, robot: bool, output: Path | None, network: bool) -> None:
    """Watch a simulated actuator wear out, on the terminal and on the dashboard.

    When a test detects a failure, a simulated technician repairs the actuator, and wear starts
    again. The folder stores the test history, from which a restarted monitor continues. The demo
    uses ROS_DOMAIN_ID if it is set, and a free domain otherwise.

    With --robot, an arm works in a pick-and-place cycle. `ema attach` finds its joints, learns
    their healthy motion, and names the joints whose friction rises.
    """
    with deferred_signals(*ENDING) as stop:
        # Imported here, because signals must be deferred before slow imports.
        if robot:
            from ema_cli.processes.robot_demo import run_robot_demo

            has_failed = run_robot_demo(duration_s or _ROBOT_S, output, stop, network=network)
        else:
            from ema_cli.processes.demo_run import run_demo

            has_failed = False
            run_demo(duration_s or _ACTUATOR_S, output, stop, network=network)
    if has_failed:
        sys.exit(UNUSABLE)
    if stop.number is not None:
        sys.exit(128 + stop.number)
