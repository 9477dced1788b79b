# SPDX-License-Identifier: Apache-2.0
"""Execution of the robot demo: a simulated arm, monitored by `ema attach`."""

import os
from datetime import datetime
from pathlib import Path
from typing import Final

import click

from ema_cli.processes.attach_run import AttachOptions, run_attach
from ema_cli.processes.bringup import parameter_file, program, ros_arguments
from ema_cli.processes.stop_request import StopRequest
from ema_core.domains import Domain

ACCEPT_AFTER: Final = 4
"""Number of healthy records after which the demo accepts a baseline."""

# A record has two cycles, and all records are analysed.
_ASSIGNMENTS: Final = ("record_interval_s:=0.0", "record_s:=44.0")


def run_robot_demo(
    duration_s: float, output: Path | None, stop: StopRequest, *, network: bool = False
) -> bool:
    """Run the demo for a time or until a stop is requested; return whether a node has failed.

    Raises
    ------
    ValueError
        If the output folder is not empty.
    """
    if "ROS_DOMAIN_ID" not in os.environ:
        os.environ["ROS_DOMAIN_ID"] = str(Domain().number)
    folder = output or Path("bags", f"demo_robot_{datetime.now():%Y%m%d_%H%M%S}")
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"{folder} already exists: expected a new or empty folder")
    robot = [
        str(program("robot")),
        # In the root namespace, in which robot drivers publish.
        *ros_arguments("robot", parameter_files=[parameter_file("demo_robot")], namespace="/"),
    ]
    click.echo(
        "a simulated arm works in a pick-and-place cycle; friction of elbow and wrist_2 rises\n"
        f"to watch from another shell, after `. ./activate.sh`: "
        f"ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']} ema watch{' --network' * network}"
    )
    options = AttachOptions(
        accept_after=ACCEPT_AFTER, folder=folder, assignments=_ASSIGNMENTS, duration_s=duration_s
    )
    return run_attach(options, stop, network=network, further={"robot": robot})
