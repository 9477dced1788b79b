"""A graph of node processes in a domain of its own, with an observer beside them."""

import itertools
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import rclpy
from ament_index_python.packages import get_package_prefix
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from ema_interfaces.msg import FaultEstimate, Health
from ema_messages.topics import LATCHED, NAMESPACE

PACKAGES = {
    "actuator": "ema_sim",
    "monitor": "ema_monitor",
    "player": "ema_recording",
    "recorder": "ema_recording",
}
_number = itertools.count(1)


def fail(error: Exception) -> None:
    """Let a test fail by what a callback raised in a thread."""
    raise error


class Graph:
    """Starts nodes as processes, listens to what they say and ends them."""

    def __init__(self) -> None:
        self.domain = 1 + (os.getpid() * 7 + next(_number) * 13) % 101
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.estimates: list[FaultEstimate] = []
        self.latencies_s: list[float] = []
        self.healths: list[Health] = []
        self.status: dict[str, tuple[int, str, dict[str, str]]] = {}
        self.told: dict[str, list[str]] = {}
        self._logs = Path(tempfile.mkdtemp(prefix="ema_graph_"))
        self._context = Context()
        self._stop = threading.Event()

    def __enter__(self) -> Self:
        rclpy.init(context=self._context, domain_id=self.domain)
        self.node = rclpy.create_node("observer", namespace="/test", context=self._context)
        self.node.create_subscription(
            FaultEstimate, f"{NAMESPACE}/fault_estimate", self._note_estimate, 1000
        )
        self.node.create_subscription(Health, f"{NAMESPACE}/health", self.healths.append, LATCHED)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._note_status, 100)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._spinning = threading.Thread(target=self._spin)
        self._spinning.start()
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes.values():
            process.kill()
            process.wait()
        self._stop.set()
        self._spinning.join()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)

    def start(self, name: str, **parameters: Any) -> None:
        """Start a node with parameters; a dot in a name is written as two underscores.

        A monitor keeps no history unless told where.
        """
        if name == "monitor":
            parameters = {"history_folder": "''", **parameters}
        package = PACKAGES[name]
        program = Path(get_package_prefix(package)) / "lib" / package / f"{name}_node"
        given = [f"{key.replace('__', '.')}:={value}" for key, value in parameters.items()]
        arguments = [word for item in given for word in ("-p", item)]
        with self.log(name).open("wb") as log:
            self.processes[name] = subprocess.Popen(
                [program, "--ros-args", *arguments],
                stdout=log,
                stderr=log,
                env={**os.environ, "ROS_DOMAIN_ID": str(self.domain)},
            )

    def stop(self, name: str, number: signal.Signals = signal.SIGINT) -> tuple[int, float]:
        """Send a signal to a node; return its exit code and how long it took [s]."""
        process = self.processes.pop(name)
        process.send_signal(number)
        started = time.monotonic()
        return process.wait(timeout=20), time.monotonic() - started

    def log(self, name: str) -> Path:
        """Return the file that holds what a node prints."""
        return self._logs / f"{name}.log"

    def has_told(self, task: str, words: str) -> bool:
        """Return whether the status of a task ever held some words."""
        return any(words in message for message in self.told.get(task, []))

    def wait_for(self, condition: Callable[[], Any], what: str, timeout_s: float = 20.0) -> None:
        """Wait until a condition holds."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if time.monotonic() > deadline:
                logs = "\n".join(path.read_text() for path in sorted(self._logs.iterdir()))
                raise AssertionError(
                    f"waited {timeout_s:g} s for {what}; status: {self.status}\n{logs}"
                )
            time.sleep(0.02)

    def _spin(self) -> None:
        while not self._stop.is_set():
            self._executor.spin_once(timeout_sec=0.1)

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
