# SPDX-License-Identifier: Apache-2.0
"""A graph of nodes as processes in a domain of its own, and what listens to it."""

import os
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Final, Self

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor

from ema_cli.processes.bringup import assignments_of, program, ros_arguments
from ema_core.domains import Domain

Process = subprocess.Popen[bytes]

_PATIENCE_S: Final = 180.0
_LAST_S: Final = 10.0


class Graph(AbstractContextManager["Graph", None]):
    """Starts processes, listens to their status and to topics, and ends what runs when it is left.

    ``statuses`` has the latest values of each status by its name, ``message`` among them.
    """

    def __enter__(self) -> Self:
        self._domain = Domain()
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        os.environ["ROS_DOMAIN_ID"] = str(self._domain.number)
        rclpy.init()
        self._node = rclpy.create_node("benchmark", namespace="/benchmark")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._processes: list[Process] = []
        self.statuses: dict[str, dict[str, str]] = {}
        self.listen(DiagnosticArray, "/diagnostics", self._note_status, 1000)
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.send_signal(signal.SIGINT)
        for process in self._processes:
            try:
                process.wait(_LAST_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown()
        self._domain.close()

    def run(self, command: Sequence[str | Path]) -> Process:
        """Start a process."""
        self._processes.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
        return self._processes[-1]

    def start(self, node: str, files: Sequence[Path] = (), **parameters: Any) -> Process:
        """Start the process of a node with its own parameter file, others and parameters."""
        arguments = ros_arguments(
            node, parameter_files=files, assignments=assignments_of(parameters)
        )
        return self.run([program(node), *arguments])

    def listen(
        self, message_class: type, topic: str, note: Callable[[Any], None], qos: Any
    ) -> None:
        """Have something called with each message of a topic."""
        self._node.create_subscription(message_class, topic, note, qos)

    def wait(self, is_over: Callable[[], bool], what: str = "") -> None:
        """Take in what comes until something holds; what is named must not take long."""
        end_s = time.monotonic() + _PATIENCE_S
        while not is_over():
            self._executor.spin_once(timeout_sec=0.05)
            if what and time.monotonic() > end_s:
                raise RuntimeError(f"not within {_PATIENCE_S:g} s: {what}")

    def wait_for_status(self, name: str, is_reached: Callable[[dict[str, str]], bool]) -> None:
        """Wait until a status is as wanted; what was published before does not count."""
        self.statuses.clear()
        self.wait(lambda: name in self.statuses and is_reached(self.statuses[name]), name)

    def _note_status(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self.statuses[status.name] = {"message": status.message, **values}
