# SPDX-License-Identifier: Apache-2.0
"""Execution of the demo: domain, folder, nodes and shutdown."""

import os
import time
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Final

import click
import numpy as np

from ema_cli.bags.diagnoses import DiagnosedWindow, read_history
from ema_cli.processes.bringup import assignments_of, parameter_file, program, ros_arguments
from ema_cli.processes.listener import refuse_running
from ema_cli.processes.observer import Observer
from ema_cli.processes.reach import set_reach
from ema_cli.processes.stop_request import StopRequest
from ema_cli.processes.supervisor import POLL_S, Supervisor
from ema_cli.show.live_table import LiveTable
from ema_core.domains import Domain
from ema_core.levels import ERROR, LEVEL_NAMES, OK, WARN
from ema_core.yaml_file import load_yaml
from ema_ros.topics import NAMESPACE

SHOWN: Final = ("friction", "backlash", "short_circuit_a")
"""Faults that grow in the demo."""

_NODES: Final = ("recorder", "dashboard", "monitor", "actuator")
_START_S: Final = 180.0  # the first run compiles the kernels
_LAST_CYCLE_S: Final = 10.0
_LAST_WINDOW_S: Final = 8.0
_REFRESH_S: Final = 0.25


def run_demo(
    duration_s: float, output: Path | None, stop: StopRequest, *, network: bool = False
) -> None:
    """Run the demo for ``duration_s`` [s] from the first test cycle, or until a stop is requested.

    Raises
    ------
    ValueError
        If a node fails or is already running, or the output folder is not empty.
    """
    set_reach(network)
    if "ROS_DOMAIN_ID" not in os.environ:
        os.environ["ROS_DOMAIN_ID"] = str(Domain().number)
    files = [parameter_file("simulated"), parameter_file("demo")]
    commands = {
        node: [str(program(node)), *ros_arguments(node, parameter_files=files)] for node in _NODES
    }
    folder = output or Path("bags", f"demo_{datetime.now():%Y%m%d_%H%M%S}")
    if folder.exists() and any(folder.iterdir()):
        raise ValueError(f"{folder} already exists: expected a new or empty folder")
    refuse_running([f"{NAMESPACE}/{node}" for node in _NODES], "demo", stop)
    if stop:
        return
    folder.mkdir(parents=True, exist_ok=True)
    bag, picture = folder / "bag", folder / "history.png"
    for node, name, path in (
        ("recorder", "output", bag),
        ("monitor", "history_folder", folder / "history"),
    ):
        commands[node] += ["-p", *assignments_of({name: str(path)})]
    with LiveTable(SHOWN) as table, Supervisor(table.report, "recorder") as processes:
        table.report(f"starting simulator, monitor, dashboard and recorder; logs in {folder}")
        watch = f"ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']} ema watch{' --network' * network}"
        table.report(f"to watch from another shell, run `. ./activate.sh`, then: {watch}")
        for node, command in commands.items():
            if not stop:
                processes.start(node, command, folder / f"{node}.log")
        with Observer("demo") as observer:
            _watch(duration_s, observer, table, processes, stop)
            if not stop and not processes.failed:
                _finish(observer, table, processes, stop)
            processes.stop_all()
            table.show(observer.diagnoses(), "finished", final=True)
        if processes.failed:
            node = processes.failed[0]
            log = folder / f"{node}.log"
            lines = filter(
                str.strip, reversed(log.read_text(errors="replace", encoding="utf-8").split("\n"))
            )
            raise ValueError(f"{node} failed: {next(lines, 'no output')}; see {log}")
    if stop:
        click.echo(f"interrupted; bag {bag}" if bag.exists() else "interrupted")
        return
    _conclude(bag, picture, folder)


class Technician:
    """Simulated technician who repairs the demo actuator after a test shows a failure."""

    def __init__(self) -> None:
        demo = load_yaml(parameter_file("demo"))["/**/actuator"]["ros__parameters"]
        self._growth = demo["growth"]
        self._is_repairing = False

    def look(self, diagnoses: Sequence[DiagnosedWindow], observer: Observer) -> str:
        """Repair the actuator after a new failure.

        Return a message about a new failure or a confirmed repair, or "" if there is neither.
        """
        last = next(
            (window for window in reversed(diagnoses) if window.level in (OK, WARN, ERROR)), None
        )
        if last is None or last.level is None:
            return ""
        if (last.level == ERROR) == self._is_repairing:
            return ""
        self._is_repairing = not self._is_repairing
        if last.level != ERROR:
            return f"cycle {last.cycle} confirms the repair: {LEVEL_NAMES[last.level]} again"
        observer.begin_life(self._growth)
        return (
            f"failed in cycle {last.cycle}: {last.cause}\nnext: remove the unit, repair the worn "
            "part, and run two tests, which lower the level if they agree; the demo does so "
            "now, then wear starts again"
        )


def _watch(
    duration_s: float,
    observer: Observer,
    table: LiveTable,
    processes: Supervisor,
    stop: StopRequest,
) -> None:
    """Show the diagnoses until the time is up, a node fails or a stop is requested."""
    began, technician = time.monotonic(), Technician()
    first_cycle: float | None = None
    address = ""
    while not stop and not processes.failed:
        now = time.monotonic()
        diagnoses, cycles = observer.diagnoses(), observer.cycles()
        if not address and (address := observer.dashboard_address):
            table.report(f"dashboard at {address}")
        if first_cycle is None and cycles:
            first_cycle = now
        if first_cycle is None:
            state = "waiting for the first test cycle"
            if now - began > _START_S:
                raise ValueError(f"no test cycle started within {_START_S:g} s; see the logs")
        else:
            left_s = duration_s - (now - first_cycle)
            state = f"test cycle {cycles - 1}, {max(0.0, left_s):.0f} s left, Ctrl-C ends the demo"
            if left_s < 0.0 and (diagnoses or now - began > duration_s + _START_S):
                break
        table.show(diagnoses, state)
        if words := technician.look(diagnoses, observer):
            table.report(words)
        _await(lambda: False, _REFRESH_S, processes, stop)


def _finish(observer: Observer, table: LiveTable, processes: Supervisor, stop: StopRequest) -> None:
    """Stop the actuator between two test cycles, and the monitor after its last diagnosis."""
    table.show(observer.diagnoses(), "ending after this test cycle")
    _await(lambda: observer.cycle_between_windows() is not None, _LAST_CYCLE_S, processes, stop)
    last = observer.cycle_between_windows()
    processes.stop("actuator")
    if last is not None:
        table.show(observer.diagnoses(), "waiting for the last window")
        _await(lambda: observer.has_diagnosed(last), _LAST_WINDOW_S, processes, stop)
    processes.stop("monitor")


def _await(
    is_reached: Callable[[], bool], longest_s: float, processes: Supervisor, stop: StopRequest
) -> None:
    deadline = time.monotonic() + longest_s
    while time.monotonic() < deadline and not (stop or processes.failed or is_reached()):
        time.sleep(POLL_S)
        processes.check()


def _conclude(bag: Path, picture: Path, folder: Path) -> None:
    # Imported here, because the import takes a second and would delay the start.
    from ema_cli.figures.files import save_picture
    from ema_cli.figures.history import draw_history

    try:
        history = read_history(bag)
    except ValueError as error:
        raise ValueError(f"{error}; see {folder / 'monitor.log'}") from error
    diagnoses = history.diagnoses()
    save_picture(draw_history(history), picture)
    latencies = [window.latency_s for window in diagnoses]
    valid = sum(window.valid for window in diagnoses)
    click.echo(
        f"{len(history.truths)} test cycles, {valid} valid estimates, latency median "
        f"{np.median(latencies):.2f} s, 95 % below {np.quantile(latencies, 0.95):.2f} s"
    )
    click.echo(f"bag      {bag}")
    click.echo(f"picture  {picture}")
    click.echo(f"next     ema report {bag}")
