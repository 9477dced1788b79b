"""How promptly nodes end on request, and write a recording to disk.

    python benchmarks/promptness.py [--repeats N] [--json FILE]

Prints how long the process of each node takes from SIGINT to its end, that of the monitor while it
identifies as well, and how much of a recording is lost when its recorder is killed. Fails when a
target is missed. The tests wait for the same ends, but for any time: how long they take depends on
what else the machine does.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rich.console import Console
from rich.table import Table

from ema_bags.reader import Bag
from ema_cli.processes.bringup import program

END_S: Final = 2.0
LOST_S: Final = 0.5
_PATIENCE_S: Final = 60.0


class Status:
    """What nodes publish of themselves."""

    def __init__(self) -> None:
        self._node = rclpy.create_node("promptness")
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._keep, 100)
        self._values: dict[str, dict[str, str]] = {}

    def _keep(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self._values[status.name] = {"message": status.message, **values}

    def wait(self, name: str, is_reached: Callable[[dict[str, str]], bool]) -> None:
        """Wait until a status is as wanted; what was published before does not count."""
        self._values.clear()
        end_s = time.monotonic() + _PATIENCE_S
        while name not in self._values or not is_reached(self._values[name]):
            rclpy.spin_once(self._node, timeout_sec=0.05)
            if time.monotonic() > end_s:
                raise click.ClickException(f"no such status of {name} within {_PATIENCE_S:g} s")


def start(name: str, **parameters: Any) -> subprocess.Popen[bytes]:
    """Start the process of a node."""
    options = [word for key, value in parameters.items() for word in ("-p", f"{key}:={value}")]
    command = [program(name), "--ros-args", *options]
    return subprocess.Popen(command, stderr=subprocess.DEVNULL)


def ended_s(process: subprocess.Popen[bytes]) -> float:
    """Interrupt a process; return how long it takes to end [s]."""
    begin_s = time.monotonic()
    process.send_signal(signal.SIGINT)
    process.wait()
    return time.monotonic() - begin_s


def ends(status: Status, name: str, **parameters: Any) -> float:
    """Return how long a node that is up takes to end [s]."""
    process = start(name, **parameters)
    status.wait(f"/ema/{name}: lifecycle", lambda values: values["message"] == "active")
    return ended_s(process)


def ends_while_it_identifies(status: Status) -> float:
    """Return how long a monitor takes to end in the midst of an identification [s]."""
    actuator = start("actuator")
    # At ten million evaluations it takes minutes.
    monitor = start("monitor", algorithm="pso", budget=10_000_000, history_folder="memory")
    status.wait("/ema/monitor: flap telemetry", lambda values: values.get("windows", "0") != "0")
    took_s = ended_s(monitor)
    ended_s(actuator)
    return took_s


def lost_s(status: Status, folder: Path) -> float:
    """Return how much of a recording is lost when its recorder is killed [s]."""
    actuator, recorder = start("actuator"), start("recorder", output=folder)
    status.wait("/ema/recorder: recording", lambda values: int(values.get("messages", 0)) > 300)
    recorder.kill()
    killed_ns = time.time_ns()
    recorder.wait()
    ended_s(actuator)
    last = list(Bag(folder).raw_messages())[-1]
    return 1e-9 * (killed_ns - last.log_time_ns)


@click.command()
@click.option("--repeats", default=5, show_default=True, type=click.IntRange(1))
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(repeats: int, output: Path | None) -> None:
    """Print the table, write the JSON file and fail when a target is missed."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    rclpy.init()
    status = Status()
    with tempfile.TemporaryDirectory() as place:
        numbers = iter(range(10**6))

        def recording() -> Path:
            return Path(place, str(next(numbers)))

        cases: dict[str, tuple[float, Callable[[], float]]] = {
            "actuator: SIGINT to end": (END_S, lambda: ends(status, "actuator")),
            "monitor: SIGINT to end": (
                END_S,
                lambda: ends(status, "monitor", history_folder="memory"),
            ),
            "  while it identifies": (END_S, lambda: ends_while_it_identifies(status)),
            "recorder: SIGINT to end": (
                END_S,
                lambda: ends(status, "recorder", output=recording()),
            ),
            "recorder: lost when killed": (LOST_S, lambda: lost_s(status, recording())),
        }
        figures = {
            name: {"target_s": target_s, "values_s": [measure() for _ in range(repeats)]}
            for name, (target_s, measure) in cases.items()
        }
    table = Table("", "median [s]", "at most [s]", "target [s]", title=f"of {repeats} each")
    for name, row in figures.items():
        table.add_row(
            name,
            f"{np.median(row['values_s']):.2f}",
            f"{max(row['values_s']):.2f}",
            f"<= {row['target_s']:g}",
        )
    Console(width=100).print(table)
    if output:
        output.write_text(json.dumps(figures, indent=2))
    if any(max(row["values_s"]) > row["target_s"] for row in figures.values()):
        sys.exit(1)


if __name__ == "__main__":
    main()
