"""A graph of node processes in a domain of its own, with an observer beside them."""

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, Self

from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ema_cli.processes.domains import Domain
from ema_interfaces.msg import FaultEstimate, Health
from ema_ros.topics import LATCHED, NAMESPACE

from ..waiting import DEADLINE_S, wait_for
from .spinning import end, ros_context, spinning

PACKAGES = {
    "actuator": "ema_sim",
    "bridge": "ema_bags",
    "dashboard": "ema_dashboard",
    "monitor": "ema_monitor",
    "player": "ema_bags",
    "recorder": "ema_bags",
}


class Graph:
    """Starts nodes as processes, listens to what they say and ends them."""

    def __init__(self) -> None:
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.estimates: list[FaultEstimate] = []
        self.latencies_s: list[float] = []
        self.healths: list[Health] = []
        self.status: dict[str, tuple[int, str, dict[str, str]]] = {}
        self.told: dict[str, list[str]] = {}
        self._open = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            logs = tempfile.TemporaryDirectory(prefix="ema_graph_")
            self._logs = Path(opened.enter_context(logs))
            self._domain = opened.enter_context(closing(Domain()))
            context = opened.enter_context(ros_context(self._domain.number))
            self.node = Node("observer", namespace="/test", context=context)
            opened.callback(end, self.node)
            self.node.create_subscription(
                FaultEstimate, f"{NAMESPACE}/fault_estimate", self._note_estimate, 1000
            )
            self.node.create_subscription(
                Health, f"{NAMESPACE}/health", self.healths.append, LATCHED
            )
            self.node.create_subscription(DiagnosticArray, "/diagnostics", self._note_status, 100)
            executor = SingleThreadedExecutor(context=context)
            opened.enter_context(spinning(executor, self.node))
            self._open = opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes.values():
            process.kill()
            process.wait()
        self._open.close()

    @property
    def domain_id(self) -> int:
        """Domain of all nodes."""
        return self._domain.number

    def start(self, name: str, **parameters: Any) -> None:
        """Start a node with parameters; a dot in a name is written as two underscores.

        A monitor keeps no history unless told where.
        """
        if name == "monitor":
            parameters = {"history_folder": "memory", **parameters}
        package = PACKAGES[name]
        program = Path(get_package_prefix(package)) / "lib" / package / f"{name}_node"
        given = [f"{key.replace('__', '.')}:={value}" for key, value in parameters.items()]
        arguments = [word for item in given for word in ("-p", item)]
        with self.log(name).open("wb") as log:
            self._begin(name, [program, "--ros-args", *arguments], log)

    def start_other(self, name: str, command: list[Any]) -> None:
        """Start what is no node of ours, in the same domain."""
        with self.log(name).open("wb") as log:
            self._begin(name, command, log)

    def _begin(self, name: str, command: list[Any], log: Any) -> None:
        self.processes[name] = subprocess.Popen(
            command,
            stdout=log,
            stderr=log,
            env={**os.environ, "ROS_DOMAIN_ID": str(self._domain.number)},
            pass_fds=[self._domain.descriptor],
        )

    def stop(self, name: str, number: signal.Signals = signal.SIGINT) -> int:
        """Send a signal to a node; return its exit code once it has ended."""
        process = self.processes.pop(name)
        process.send_signal(number)
        return process.wait(timeout=DEADLINE_S)

    def log(self, name: str) -> Path:
        """Return the file that holds what a node prints."""
        return self._logs / f"{name}.log"

    def wait_for(self, condition: Callable[[], Any], what: str) -> None:
        """Wait until a condition holds."""
        try:
            wait_for(condition, what)
        except AssertionError as error:
            logs = "\n".join(path.read_text() for path in sorted(self._logs.iterdir()))
            raise AssertionError(f"{error}; status: {self.status}\n{logs}") from error

    def _note_estimate(self, message: FaultEstimate) -> None:
        end = message.window_end
        self.latencies_s.append(time.time() - end.sec - end.nanosec * 1e-9)
        self.estimates.append(message)

    def _note_status(self, message: DiagnosticArray) -> None:
        for item in message.status:
            values = {pair.key: pair.value for pair in item.values}
            self.status[item.name] = (item.level[0], item.message, values)
            told = self.told.setdefault(item.name, [])
            if not told or told[-1] != item.message:
                told.append(item.message)
