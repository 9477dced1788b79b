# SPDX-License-Identifier: Apache-2.0
"""A graph of node processes in a separate domain, with an observer node."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, NamedTuple, Self

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ema_cli.processes.bringup import assignments_of, program
from ema_core.domains import Domain
from ema_interfaces.msg import FaultEstimate, Health, TelemetryBlock
from ema_ros.topics import LATCHED, NAMESPACE, STREAM

from ..waiting import DEADLINE_S, wait_for
from .spinning import end, ros_context, spinning


class Status(NamedTuple):
    """The latest status of a task; ``came_s`` is its time of reception [s]."""

    level: int
    message: str
    values: dict[str, str]
    came_s: float


class Graph:
    """A graph that starts, stops, kills and pauses node processes, and records their messages.

    Attributes
    ----------
    processes
        Running processes by name.
    began_s
        Time of the last start of each process by the machine's clock [s].
    received
        All estimates so far, each with its time of reception [s].
    status
        Latest status by name.
    reported
        Messages of each status in order, without repetitions.
    blocks
        Time at which each telemetry block was sent [ns], and received [s].
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.began_s: dict[str, float] = {}
        self.received: list[tuple[float, FaultEstimate]] = []
        self.healths: list[Health] = []
        self.status: dict[str, Status] = {}
        self.reported: dict[str, list[str]] = {}
        self.blocks: list[tuple[int, float]] = []
        self._open = ExitStack()

    def __enter__(self) -> Self:
        self.folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as opened:
            self._domain = opened.enter_context(closing(Domain()))
            context = opened.enter_context(ros_context(self._domain.number))
            self.node = Node("observer", namespace="/test", context=context)
            opened.callback(end, self.node)
            # rclpy passes the message information to callbacks with two arguments.
            note_block: Any = self._note_block
            listen = self.node.create_subscription
            listen(FaultEstimate, f"{NAMESPACE}/fault_estimate", self._note_estimate, STREAM)
            listen(Health, f"{NAMESPACE}/health", self.healths.append, LATCHED)
            listen(DiagnosticArray, "/diagnostics", self._note_status, STREAM)
            listen(TelemetryBlock, f"{NAMESPACE}/telemetry", note_block, STREAM, raw=True)
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
        """ROS domain of all nodes."""
        return self._domain.number

    @property
    def estimates(self) -> list[FaultEstimate]:
        """All estimates so far."""
        return [estimate for _, estimate in self.received]

    def start(
        self, name: str, node: str = "", remaps: Sequence[str] = (), **parameters: Any
    ) -> None:
        """Start a node with parameters; write two underscores for a dot in their names.

        A monitor keeps no history unless ``history_folder`` is given.
        """
        if (node or name) == "monitor":
            parameters = {"history_folder": "", **parameters}
        texts = {
            key.replace("__", "."): str(value) if isinstance(value, Path) else value
            for key, value in parameters.items()
        }
        words = [word for item in assignments_of(texts) for word in ("-p", item)]
        words += [word for item in (*remaps, f"__ns:={NAMESPACE}") for word in ("-r", item)]
        self.start_other(name, [program(node or name), "--ros-args", *words])

    def start_other(self, name: str, command: list[Any]) -> None:
        """Start any other program in the same domain."""
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(self.domain_id),
            "ROS_HOME": str(self.folder / "ros_home"),
        }
        self.began_s[name] = time.time()
        with self.log(name).open("ab") as log:
            self.processes[name] = subprocess.Popen(
                command, stdout=log, stderr=log, env=environment, pass_fds=[self._domain.descriptor]
            )

    def kill(self, name: str) -> float:
        """Kill a node with SIGKILL. Return the time by the machine's clock [s]."""
        assert self.stop(name, signal.SIGKILL) == -signal.SIGKILL
        return time.time()

    def stop(self, name: str, number: signal.Signals = signal.SIGINT) -> int:
        """Send a signal to a node. Wait until it ends and return its exit code."""
        self.processes[name].send_signal(number)
        return self.exit_code(name)

    def exit_code(self, name: str) -> int:
        """Wait until a node ends, and return its exit code."""
        try:
            code = self.processes[name].wait(DEADLINE_S)
        except subprocess.TimeoutExpired as error:
            raise AssertionError(f"{name} did not end within {DEADLINE_S:g} s") from error
        del self.processes[name]
        return code

    def pause(self, name: str) -> None:
        """Pause the process of a node by SIGSTOP."""
        self.processes[name].send_signal(signal.SIGSTOP)

    def resume(self, name: str) -> None:
        """Resume a paused node."""
        self.processes[name].send_signal(signal.SIGCONT)

    def log(self, name: str) -> Path:
        """Return the path of the log of a node's output."""
        return self.folder / f"{name}.log"

    def failures(self) -> list[str]:
        """Return the last line of each log that contains a traceback."""
        return [
            f"{path.name}: {text.strip().splitlines()[-1]}"
            for path in sorted(self.folder.glob("*.log"))
            if "Traceback" in (text := path.read_text(errors="replace"))
        ]

    def wait_for(
        self, condition: Callable[[], Any], what: str, deadline_s: float = DEADLINE_S
    ) -> Any:
        """Wait until a condition is true, and return its value. Fail if a node ends."""

        def holds() -> Any:
            result = condition()
            if not result:
                self.check_alive()
            return result

        try:
            return wait_for(holds, what, deadline_s)
        except AssertionError as error:
            logs = "\n".join(path.read_text() for path in sorted(self.folder.glob("*.log")))
            raise AssertionError(f"{error}; status: {self.status}\n{logs}") from error

    def wait(self, seconds: float) -> None:
        """Wait for some seconds. Fail if a node ends."""
        end_s = time.monotonic() + seconds
        self.wait_for(lambda: time.monotonic() >= end_s, "the time", seconds + DEADLINE_S)

    def check_alive(self) -> None:
        """Fail if a node has ended by itself."""
        for name, process in self.processes.items():
            code = process.poll()
            assert code is None, f"{name} has ended by itself with code {code}"

    def reports(self, status: str, text: str, since_s: float = 0.0) -> bool:
        """Return whether a status contains a text in its message and came after a time [s]."""
        latest = self.status.get(status)
        return latest is not None and latest.came_s > since_s and text in latest.message

    def valid_since(self, since_s: float) -> list[FaultEstimate]:
        """Return the valid estimates that came after a time [s]."""
        return [item for came_s, item in self.received if item.valid and came_s > since_s]

    def _note_estimate(self, message: FaultEstimate) -> None:
        self.received.append((time.time(), message))

    def _note_status(self, message: DiagnosticArray) -> None:
        for item in message.status:
            values = {pair.key: pair.value for pair in item.values}
            self.status[item.name] = Status(item.level[0], item.message, values, time.time())
            reported = self.reported.setdefault(item.name, [])
            if not reported or reported[-1] != item.message:
                reported.append(item.message)

    def _note_block(self, _: bytes, information: Any) -> None:
        self.blocks.append(
            (information["source_timestamp"], information["received_timestamp"] * 1e-9)
        )
