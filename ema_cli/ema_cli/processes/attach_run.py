# SPDX-License-Identifier: Apache-2.0
"""Execution of `ema attach`: nodes, list of joints and live table."""

import math
import os
import re
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import click
import numpy as np

from ema_cli.processes.bringup import assignments_of, parameter_file, program, ros_arguments
from ema_cli.processes.health_listener import HealthListener
from ema_cli.processes.listener import refuse_running
from ema_cli.processes.reach import set_reach
from ema_cli.processes.stop_request import StopRequest
from ema_cli.processes.supervisor import POLL_S, Supervisor
from ema_cli.show.health_table import HealthTable
from ema_cli.show.joint_list import JointList
from ema_core.description import ActuatorDescription
from ema_interfaces.msg import ActuatorDescription as DescriptionMessage
from ema_interfaces.msg import NodeStatus
from ema_monitor.baselines.unit_baseline import default_folder
from ema_ros import topics
from ema_ros.messages import description_from_message
from ema_ros.topics import NAMESPACE

_NODES: Final = ("recorder", "dashboard", "monitor", "bridge")
_SEARCH_S: Final = 10.0
_SETTLED_S: Final = 3.0
_REFRESH_S: Final = 0.25
_MOST_RECORDED: Final = 1_000_000_000
_MOST_LOGGED: Final = 20_000_000
_BLOCK: Final = 4096
"""Smallest space on disk that a file occupies [B]."""
_RUN: Final = re.compile(r"\d{8}T\d{6}Z")


@dataclass(frozen=True)
class AttachOptions:
    """Options of `ema attach`."""

    joints: tuple[str, ...] = ()
    """Patterns of the names of joints to monitor; empty for all."""
    topics: tuple[str, ...] = ()
    """Joint state topics; empty for all."""
    effort_unit: str | None = None
    """Unit of the effort; None for the configured unit."""
    accept_after: int = 0
    """Number of records after which a baseline is accepted; 0 if a person accepts it."""
    folder: Path | None = None
    """Folder of baselines, history, recordings and logs; None for the folder in ``$ROS_HOME``."""
    namespace: str = NAMESPACE
    """Full namespace of the nodes."""
    assignments: tuple[str, ...] = ()
    """Parameters of the nodes as ``NAME:=VALUE``."""
    duration_s: float = math.inf
    """Duration of the run after the first joints are detected [s]."""


def run_attach(
    options: AttachOptions,
    stop: StopRequest,
    *,
    network: bool,
    further: Mapping[str, Sequence[str]] | None = None,
) -> bool:
    """Run the nodes until the time is up or a stop is requested; return whether a node failed.

    Parameters
    ----------
    options
        Options of the command.
    stop
        Request to stop.
    network
        Whether the nodes communicate with other machines.
    further
        Commands of further nodes, keyed by name; these nodes are started and stopped as well.
    """
    set_reach(network)
    folder = options.folder or default_folder().parent
    refuse_running([f"{options.namespace}/{node}" for node in _NODES], "attach", stop)
    if stop:
        return False
    started = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    logs = folder / "logs" / started
    logs.mkdir(parents=True, exist_ok=True)
    _limit_size(folder / "recordings", _MOST_RECORDED)
    _limit_size(folder / "logs", _MOST_LOGGED)
    table = HealthTable(f"on {options.namespace}")
    with (
        Supervisor(
            lambda line: table.report(f"ema attach: {line}", is_error=True), "recorder"
        ) as nodes,
        _Joints(options) as joints,
    ):
        for node, command in (_commands(options, folder, started) | dict(further or {})).items():
            if not stop:
                nodes.start(node, command, logs / f"{node}.log")
        _list_joints(joints, nodes, stop, network=network)
        with table:
            end_s = time.monotonic() + options.duration_s
            while nodes.running and not stop and time.monotonic() < end_s:
                for line in joints.new_lines():
                    table.report(line)
                table.show(joints.healths.rows(), "")
                joints.healths.changed.wait(_REFRESH_S)
                joints.healths.changed.clear()
                nodes.check()
        for node in nodes.failed:
            click.echo(f"{node} failed: see {logs / f'{node}.log'}", err=True)
    return bool(nodes.failed)


def _limit_size(folder: Path, most: int) -> None:
    """Delete the oldest runs in a folder until the remaining runs have at most ``most`` bytes.

    The latest run is never deleted. Folders without the name of a run are ignored.
    """
    runs = sorted(path for path in folder.glob("*") if _is_run(path))
    sizes = [sum(max(_BLOCK, file.lstat().st_size) for file in run.rglob("*")) for run in runs]
    for run, remaining in zip(runs[:-1], np.cumsum(sizes[::-1])[::-1][:-1], strict=True):
        if remaining > most:
            shutil.rmtree(run, ignore_errors=True)


def _is_run(path: Path) -> bool:
    return bool(_RUN.fullmatch(path.name)) and path.is_dir() and not path.is_symlink()


def _commands(options: AttachOptions, folder: Path, started: str) -> dict[str, Sequence[str]]:
    """Return the commands that start the nodes, keyed by node."""
    parameters: dict[str, Mapping[str, Any]] = {
        "bridge": {
            "joints": list(options.joints) or None,
            "state_topics": list(options.topics) or None,
            "effort_unit": options.effort_unit,
        },
        "monitor": {
            "baseline_folder": str(folder / "baselines"),
            "history_folder": str(folder / "history"),
            "accept_after": options.accept_after,
        },
        "recorder": {"output": str(folder / "recordings" / started)},
        "dashboard": {},
    }
    return {
        node: [
            str(program(node)),
            *ros_arguments(
                node,
                parameter_files=[parameter_file("attach")],
                assignments=[*assignments_of(parameters[node]), *options.assignments],
                namespace=options.namespace,
            ),
        ]
        for node in _NODES
    }


def _list_joints(joints: "_Joints", nodes: Supervisor, stop: StopRequest, *, network: bool) -> None:
    """Wait for the first joints and print them; print a hint if there are none within 10 s."""
    began_s, is_hinted = time.monotonic(), False
    while not stop and nodes.running and not joints.is_settled:
        if not is_hinted and not joints.described and time.monotonic() - began_s > _SEARCH_S:
            is_hinted = True
            click.echo(_no_joints(joints, network=network))
        time.sleep(POLL_S)
        nodes.check()
    if stop or not joints.described:
        return
    click.echo(str(joints.listed()))
    if joints.address:
        click.echo(f"page       {joints.address}")
    click.echo(
        "baselines  `ema baseline list` shows what is learned; `ema baseline accept JOINT` accepts "
        "it\nCtrl-C ends the run; the next run continues with the same baselines"
    )


def _no_joints(joints: "_Joints", *, network: bool) -> str:
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    text = f"no joint states in domain {domain} yet"
    if joints.search:
        text = f"{joints.search} (domain {domain})"
    hint = "ROS_DOMAIN_ID selects another domain"
    return f"{text}; {hint}" if network else f"{text}; {hint}, --network includes other machines"


class _Joints:
    """Collects descriptions and health of joints; a context manager.

    Attributes
    ----------
    described
        Description of each joint, keyed by name.
    healths
        Listener for health messages.
    address
        Address of the page; empty until it is published.
    search
        Result of the bridge's search for joints, as a sentence; "" before its first status.
    """

    def __init__(self, options: AttachOptions) -> None:
        self.described: dict[str, ActuatorDescription] = {}
        self.address = self.search = ""
        self._listed: set[str] = set()
        self._latest_s = 0.0
        topic = f"{options.namespace.rstrip('/')}/{topics.DESCRIPTION}"
        more = {topic: (DescriptionMessage, topics.LATCHED_BY_MANY)}
        self.healths = HealthListener([options.namespace], "attach", more, self._note)

    def __enter__(self) -> "_Joints":
        self.healths.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self.healths.__exit__()

    @property
    def is_settled(self) -> bool:
        """Whether joints were described, but no further joint in the last 3 s."""
        return bool(self.described) and time.monotonic() - self._latest_s > _SETTLED_S

    def listed(self) -> JointList:
        """Return the list of all joints so far."""
        described = dict(self.described)
        self._listed |= described.keys()
        return JointList(list(described.values()))

    def new_lines(self) -> list[str]:
        """Return a line for each joint that was first described after the previous call."""
        described = dict(self.described)
        new = described.keys() - self._listed
        self._listed |= new
        return [f"new joint {line}" for line in JointList([described[name] for name in new]).lines]

    def _note(self, topic: str, message: Any) -> None:
        if isinstance(message, NodeStatus):
            if message.kind == NodeStatus.DASHBOARD:
                self.address = message.address
            elif message.kind == NodeStatus.BRIDGE:
                self.search = message.joint_search
        else:
            try:
                description = description_from_message(message)
            except ValueError:
                return  # the monitor reports it
            self.described[description.actuator_id] = description
            self._latest_s = time.monotonic()
